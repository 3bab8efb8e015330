import csv
import gzip
import subprocess
import sys
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from replay.simulated.ecolar import COLUMNS
from replay.simulated.standins import BUILDING_67_FILE, ECOLAR_FILE, FLEXHOUSE_FILE, GENERIC_FILE, write_standins

EXAMPLES = Path(__file__).parents[3] / "deploy/examples/data"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {path.name: path for path in write_standins(tmp_path_factory.mktemp("standins"))}


def _content(path: Path) -> bytes:
    return gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()


def _rows(path: Path, delimiter: str = ",") -> list[dict[str, str]]:
    return list(csv.DictReader(_content(path).decode().splitlines(), delimiter=delimiter))


def test_committed_files_are_what_the_generator_writes(written: dict[str, Path]) -> None:
    assert {path.name for path in EXAMPLES.glob("*.csv*")} == set(written)
    for name, path in written.items():
        # Decompressed: another zlib may pack the same content into other bytes.
        assert _content(path) == _content(EXAMPLES / name), (
            f"{name}: run python -m replay.simulated.standins deploy/examples/data"
        )
        assert (EXAMPLES / name).stat().st_size < 60_000


def test_writing_again_gives_the_same_bytes(written: dict[str, Path], tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, "-m", "replay.simulated.standins", str(tmp_path)], check=True, cwd=EXAMPLES.parents[2]
    )
    for name, path in written.items():
        assert (tmp_path / name).read_bytes() == path.read_bytes()


def test_every_file_is_said_to_be_synthetic() -> None:
    text = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert "synthetic" in text
    for path in EXAMPLES.glob("*.csv*"):
        assert path.name in text


def test_flexhouse_layout(written: dict[str, Path]) -> None:
    rows = _rows(written[FLEXHOUSE_FILE])
    assert _content(written[FLEXHOUSE_FILE]).startswith(b'"t","Ta","Ps","Ph","yTi","TimeDate"\n')
    assert len(rows) == 576
    assert float(rows[12]["t"]) == 1.0
    heat = np.array([float(row["Ph"]) for row in rows])
    assert ((heat < 0.1) | ((heat > 5.1) & (heat < 5.4))).all()
    assert 15 < min(float(row["yTi"]) for row in rows) < max(float(row["yTi"]) for row in rows) < 28


def test_building_67_layout(written: dict[str, Path]) -> None:
    rows = _rows(written[BUILDING_67_FILE])
    assert len(rows) == 432
    assert {float(row["u_heat"]) for row in rows} == {0.0, 800.0}
    assert {float(row["q_unmeasured"]) for row in rows} == {0.0, 7000.0}


def test_ecolar_layout(written: dict[str, Path]) -> None:
    rows = _rows(written[ECOLAR_FILE])
    assert tuple(rows[0]) == COLUMNS
    assert any(float(row["Relay 4"] or 0) > 0 for row in rows)


def test_generic_layout(written: dict[str, Path]) -> None:
    rows = _rows(written[GENERIC_FILE], ";")
    assert list(rows[0]) == ["Zeit", "Raumtemperatur", "Aussentemperatur", "Heizleistung_kW"]
    stamps = [datetime.strptime(row["Zeit"], "%d.%m.%Y %H:%M") for row in rows]  # noqa: DTZ007
    assert {(after - before).total_seconds() for before, after in pairwise(stamps)} == {900.0}
    assert len(rows) == 192
    for row in rows:
        assert 14 < float(row["Raumtemperatur"].replace(",", ".")) < 26
