import csv
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.network.presets import PRESETS
from replay.localtime import HOUR, midnight, wall_clock
from replay.simulated.ecolar import (
    COLUMNS,
    FAULTS,
    HEATER_COLUMNS,
    PANELS,
    PERIODS,
    THETA,
    ZONE,
    ZonePeriod,
    simulate_period,
    write_raw,
    write_standin,
)

SEED = 2


@pytest.fixture(scope="module", params=["spring", "autumn"])
def name(request: pytest.FixtureRequest) -> Any:
    return request.param


@pytest.fixture(scope="module")
def period(name: str) -> ZonePeriod:
    first, last = PERIODS[name]
    return simulate_period(midnight(*first, ZONE), midnight(*last, ZONE), SEED)


@pytest.fixture(scope="module")
def rows(name: str, period: ZonePeriod, tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, str]]:
    path = write_raw(tmp_path_factory.mktemp("ecolar") / f"ecolar-{name}-SYNTHETIC.csv", period, FAULTS, SEED)
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_parameters_lie_inside_the_box_of_the_network() -> None:
    for parameter in PRESETS["ecolar-6r4c"].parameters:
        assert parameter.lower < THETA[parameter.name] < parameter.upper


def test_raw_rows_have_the_layout_cadence_and_faults(name: str, rows: list[dict[str, str]]) -> None:
    assert tuple(rows[0]) == COLUMNS
    first, last = PERIODS[name]
    assert rows[0]["Timestamp"] == f"{datetime(*first):%Y-%m-%d} 00:00:00"  # noqa: DTZ001
    stamps = np.array([row["Timestamp"] for row in rows], dtype="datetime64[s]").astype(np.int64)
    assert wall_clock(np.array([midnight(*last, ZONE)]), ZONE)[0] - stamps.max() < 120
    steps = np.diff(stamps)
    assert 10 <= np.quantile(steps, 0.01) <= np.quantile(steps, 0.99) <= 60
    assert (steps > 23 * HOUR).sum() == 1
    assert (steps > 7 * 60).sum() == len(FAULTS.gaps)
    assert (steps < 0).sum() >= FAULTS.late_rows // 2
    for column in COLUMNS[1:]:
        assert 0.001 < np.mean([row[column] == "" for row in rows]) < 0.02


def test_autumn_repeats_the_hour_of_the_clock_change(name: str, rows: list[dict[str, str]]) -> None:
    stamps = [row["Timestamp"] for row in rows if row["Timestamp"].startswith("2025-10-26 0")]
    backwards = [before for before, after in pairwise(stamps) if after < before]
    if name == "spring":
        assert not stamps
    else:
        assert len(backwards) == 1
        assert backwards[0].startswith("2025-10-26 02:59")
        assert stamps[stamps.index(backwards[0]) + 1].startswith("2025-10-26 02:00")


def test_powers_are_kilowatts(rows: list[dict[str, str]]) -> None:
    for column, panel in zip(HEATER_COLUMNS, PANELS, strict=True):
        values = [float(row[column]) for row in rows if row[column]]
        assert max(values) == pytest.approx(panel.power / 1000, rel=0.03)
        assert min(values) == 0.0


def test_same_seed_same_file_and_the_name_must_say_synthetic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PERIODS, "spring", ((2025, 5, 3), (2025, 5, 6)))
    monkeypatch.setattr("replay.simulated.ecolar.FAULTS", FAULTS._replace(gaps=(600.0,)))
    first = write_standin(tmp_path / "one-SYNTHETIC.csv", "spring", 4).read_bytes()
    assert write_standin(tmp_path / "two-synthetic.csv", "spring", 4).read_bytes() == first
    assert write_standin(tmp_path / "three-synthetic.csv", "spring", 5).read_bytes() != first
    with pytest.raises(ValueError, match="synthetic"):
        write_standin(tmp_path / "ecolar.csv", "spring", 4)
