import numpy as np

from replay.localtime import DAY, HOUR, clock_changes, midnight, wall_clock, weekday
from replay.recorded.tables import local_stamps, utc_stamps

BERLIN = "Europe/Berlin"


def test_wall_clock_repeats_an_hour_in_autumn_and_skips_one_in_spring() -> None:
    autumn = np.arange(midnight(2025, 10, 26, BERLIN), midnight(2025, 10, 27, BERLIN), HOUR)
    assert len(autumn) == 25
    assert [stamp[11:13] for stamp in local_stamps(wall_clock(autumn, BERLIN))][:5] == ["00", "01", "02", "02", "03"]
    spring = np.arange(midnight(2025, 3, 30, BERLIN), midnight(2025, 3, 31, BERLIN), HOUR)
    assert [stamp[11:13] for stamp in local_stamps(wall_clock(spring, BERLIN))][:4] == ["00", "01", "03", "04"]


def test_clock_changes_are_found() -> None:
    times = np.arange(midnight(2025, 10, 3, BERLIN), midnight(2025, 11, 21, BERLIN), 600)
    assert utc_stamps(clock_changes(times, BERLIN)) == ["2025-10-26T01:00:00Z"]
    assert clock_changes(times[: DAY // 600], BERLIN).size == 0


def test_weekday_counts_from_monday() -> None:
    monday = wall_clock(np.array([midnight(2025, 10, 6, BERLIN)]), BERLIN)
    assert weekday(monday)[0] == 0
    assert weekday(monday + 6 * DAY)[0] == 6
