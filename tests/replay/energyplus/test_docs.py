"""docs/energyplus.md says what there is: its tables are those of the code, and its example runs."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from support.energyplus import needs_energyplus

from replay.energyplus.buildings import BUILDINGS
from replay.energyplus.files import CONFIGURATION, HEAT_LOSS, RECORDING, TRUTH
from replay.energyplus.heating import HEATINGS
from replay.energyplus.plant import Truth
from replay.energyplus.weather import CITIES

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs" / "energyplus.md").read_text(encoding="utf-8")


def tables(heading: str) -> list[list[list[str]]]:
    """The rows of every table below `heading`."""
    section = re.search(rf"^#+ {heading}\n(.*?)(?=^#+ |\Z)", TEXT, re.DOTALL | re.MULTILINE)
    assert section
    found = re.findall(r"(?:^\|.*\n)+", section[1], re.MULTILINE)
    return [
        [[cell.strip() for cell in line.strip("|").split(" | ")] for line in part.splitlines()[2:]] for part in found
    ]


def test_buildings_rooms_and_heaters_are_those_in_force() -> None:
    (rows,) = tables("The buildings")
    for (name, what, rooms), building in zip(rows, BUILDINGS.values(), strict=True):
        assert name == f"`{building.name}`"
        assert what.startswith(building.what)
        assert rooms == ", ".join(f"`{room.name}` {room.heater:g} W" for room in building.rooms)
    assert all(f"`{city}`" in TEXT for city in CITIES)


def test_ways_of_heating_are_those_in_force() -> None:
    (rows,) = tables("Heating")
    assert [row[0].strip("`") for row in rows] == [*HEATINGS]


def test_files_are_those_in_force() -> None:
    (files,) = tables("Recording one")
    assert [row[0].strip("`") for row in files] == [RECORDING, CONFIGURATION, TRUTH, HEAT_LOSS]
    assert all(f"`{name}`" in TEXT for name in Truth._fields)


@needs_energyplus
def test_the_example_runs() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, timeout=300, check=False, cwd=ROOT
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(r"1\d\.\d degC indoors, -?\d+\.\d degC outdoors, -?\d+ W unmeasured\n", done.stdout), (
        done.stdout
    )
