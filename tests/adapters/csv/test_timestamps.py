from datetime import UTC, datetime
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from support.tables import tabled

from adapters.csv.cells import Status
from adapters.csv.times import parse_timestamps, to_utc
from adapters.errors import SourceConfigError
from adapters.timestamps import local_to_utc, timestamp_parser

BERLIN = ZoneInfo("Europe/Berlin")


def seconds(text):
    return datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()


def utc_of(texts, pattern="iso8601", zone=None):
    return to_utc(parse_timestamps(texts, timestamp_parser(pattern)), zone)


def wall_clock(utc, zone):
    """Wall-clock seconds of UTC seconds, one by one through the standard library: the oracle's direction."""
    moments = [datetime.fromtimestamp(time, zone) for time in utc]
    return np.array([moment.replace(tzinfo=UTC).timestamp() for moment in moments])


@tabled
def test_timestamps_become_utc(pattern, text, expected):
    times, status = utc_of([text], pattern, BERLIN)
    assert status.tolist() == [Status.GOOD]
    assert times[0] == seconds(expected)


@tabled
@pytest.mark.parametrize("zone", [None, BERLIN])
def test_an_unreadable_or_implausible_timestamp_is_bad(pattern, text, zone):
    times, status = utc_of([text], pattern, zone)
    assert status.tolist() == [Status.BAD_TIMESTAMP]
    assert np.isnan(times[0])


UNUSABLE = "use 'iso8601', 'epoch' or a strptime pattern"
PATTERNS = dict.fromkeys(("iso", "%H:%M:%S", "%d.%m.", "%Q", "%", "", "%Y-%m-%d %m"), UNUSABLE)


@pytest.mark.parametrize(
    ("pattern", "said"), [*PATTERNS.items(), ("%d.%m.%Y %I:%M", r"afternoons as mornings; use %H .* or add %p")]
)
def test_a_pattern_without_a_full_date_or_the_half_of_the_day_is_refused(pattern, said):
    with pytest.raises(SourceConfigError, match=said):
        timestamp_parser(pattern)


@tabled
@pytest.mark.parametrize("cadence", [10.0, 60.0, 900.0])
@pytest.mark.parametrize("direction", [1, -1], ids=["oldest first", "newest first"])
def test_a_recording_over_a_clock_change_comes_back_as_it_was(zone, change, cadence, direction):
    utc = (seconds(change) + np.arange(-5 * 3600, 5 * 3600, cadence))[::direction]
    assert np.array_equal(local_to_utc(wall_clock(utc, ZoneInfo(zone)), ZoneInfo(zone)), utc)


@tabled
@pytest.mark.parametrize("part", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("direction", [1, -1], ids=["oldest first", "newest first"])
@pytest.mark.parametrize("rows", [slice(None), slice(5, None), slice(None, 7)])
def test_one_record_in_each_pass_is_told_apart(zone, change, step, part, direction, rows):
    # The clock is set back between the records 5 and 6.
    utc = (seconds(change) + step * (part + np.arange(-6, 6)))[rows][::direction]
    assert np.array_equal(local_to_utc(wall_clock(utc, ZoneInfo(zone)), ZoneInfo(zone)), utc)


@tabled
@pytest.mark.parametrize("direction", [1, -1], ids=["oldest first", "newest first"])
def test_a_time_that_is_written_twice_does_not_pass_for_two_passes(clocks, direction):
    local = np.array([seconds(f"2025-10-26T{clock}:00") for clock in clocks.split()])[::direction]
    summer = 7200.0 * (local < seconds("2025-10-26T03:00:00")) + 3600.0 * (local >= seconds("2025-10-26T03:00:00"))
    assert np.array_equal(local_to_utc(local, BERLIN), local - summer)


def test_a_record_slightly_out_of_order_does_not_pass_for_the_clock_change():
    utc = seconds("2025-10-26T00:00:00") + np.arange(0, 2 * 3600, 10.0)
    for early in (30, 200, 500, 700):
        swapped = utc.copy()
        swapped[[early, early + 1]] = utc[[early + 1, early]]
        assert np.array_equal(local_to_utc(wall_clock(swapped, BERLIN), BERLIN), swapped)


def test_timestamps_with_an_offset_ignore_the_zone_even_in_the_repeated_hour():
    texts = ["2025-10-26 02:30:00+01:00", "2025-10-26 02:30:00", "2025-10-26 02:30:00+02:00"]
    times, status = utc_of(texts, zone=BERLIN)
    assert status.tolist() == [Status.GOOD] * 3
    assert (times - seconds("2025-10-26T00:30:00")).tolist() == [3600.0, 0.0, 0.0]
