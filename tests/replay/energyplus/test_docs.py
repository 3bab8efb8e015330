"""docs/energyplus.md says what there is: its tables are those of the code, and its example runs."""

import re

from support.energyplus import needs_energyplus
from support.harness import python
from support.pages import TEXT, section, tables

from replay.energyplus.buildings import BUILDINGS
from replay.energyplus.files import CONFIGURATION, HEAT_LOSS, RECORDING, TRUTH
from replay.energyplus.heating import HEATINGS
from replay.energyplus.plant import Truth
from replay.energyplus.weather import CITIES

PAGE = TEXT["energyplus.md"]


def rows(heading: str) -> list[list[str]]:
    """Those of the table below `heading`."""
    (found,) = tables(section("energyplus.md", heading))
    return found[1:]


def test_buildings_rooms_and_heaters_are_those_in_force() -> None:
    for (name, what, rooms), building in zip(rows("The buildings"), BUILDINGS.values(), strict=True):
        assert name == f"`{building.name}`"
        assert what.startswith(building.what)
        assert rooms == ", ".join(f"`{room.name}` {room.heater:g} W" for room in building.rooms)
    assert all(f"`{city}`" in PAGE for city in CITIES)


def test_ways_of_heating_are_those_in_force() -> None:
    assert [row[0].strip("`") for row in rows("Heating")] == [*HEATINGS]


def test_files_are_those_in_force() -> None:
    assert [row[0].strip("`") for row in rows("Record")] == [RECORDING, CONFIGURATION, TRUTH, HEAT_LOSS]
    assert all(f"`{name}`" in PAGE for name in Truth._fields)


@needs_energyplus
def test_the_example_runs() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    shown = python(code)
    assert re.fullmatch(r"1\d\.\d degC indoors, -?\d+\.\d degC outdoors, -?\d+ W unmeasured\n", shown), shown
