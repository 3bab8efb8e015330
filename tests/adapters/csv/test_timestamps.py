from datetime import UTC, datetime
from zoneinfo import ZoneInfo

import numpy as np
import pytest

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


@pytest.mark.parametrize(
    ("pattern", "text", "expected"),
    [
        ("iso8601", "2025-05-03T00:00:10Z", "2025-05-03T00:00:10"),
        ("iso8601", " 2025-05-03 00:00:10+02:00 ", "2025-05-02T22:00:10"),
        ("iso8601", "2025-05-03 02:00:10.25", "2025-05-03T00:00:10.25"),
        ("epoch", "1746230410.5", "2025-05-03T00:00:10.5"),
        ("%d.%m.%Y %H:%M", "03.05.2025 02:00", "2025-05-03T00:00:00"),
        ("%Y-%m-%d %H:%M:%S%z", "2025-05-03 00:00:10-0100", "2025-05-03T01:00:10"),
        ("%Y-%m-%dT%H:%M:%S%z", "2025-05-03T00:00:10Z", "2025-05-03T00:00:10"),
        ("%Y-%m-%dT%H:%M:%SZ", "2025-05-03T00:00:10Z", "2025-05-03T00:00:10"),
        ("%Y-%m-%dT%H:%M:%S.%fz", "2025-05-03T00:00:10.0Z", "2025-05-03T00:00:10"),
        ("%Y-%m-%d %H:%M:%S %Z", "2025-05-03 00:00:10 UTC", "2025-05-03T00:00:10"),
        ("%Y-%m-%d %H:%M:%S UTC", "2025-05-03 00:00:10 UTC", "2025-05-03T00:00:10"),
        ("%H:%M GMT %d.%m.%Y", "00:00 GMT 03.05.2025", "2025-05-03T00:00:00"),
        ("%Y-%m-%d %H:%M:%S %z UTC", "2025-05-03 00:00:10 +0000 UTC", "2025-05-03T00:00:10"),
        ("%Y-%m-%d %H:%M UTC%z", "2025-05-03 02:00 UTC+0200", "2025-05-03T00:00:00"),
        ("%d.%m.%Y %I:%M %p", "03.05.2025 02:00 PM", "2025-05-03T12:00:00"),
        ("Zeit %d.%m.%Y %H:%M Uhr", "Zeit 03.05.2025 02:00 Uhr", "2025-05-03T00:00:00"),
    ],
)
def test_timestamps_become_utc(pattern, text, expected):
    times, status = utc_of([text], pattern, BERLIN)
    assert status.tolist() == [Status.GOOD]
    assert times[0] == seconds(expected)


@pytest.mark.parametrize(
    ("pattern", "text"),
    [
        ("iso8601", ""),
        ("iso8601", "yesterday"),
        ("iso8601", "2025-02-30 00:00:00"),
        ("iso8601", "0001-01-01 00:00:00"),
        ("iso8601", "9999-12-31 23:59:59"),
        ("iso8601", "1969-12-31T23:59:59Z"),
        ("epoch", "1746230410000"),
        ("epoch", "nan"),
        ("epoch", "inf"),
        ("epoch", "2025-05-03"),
        ("%d.%m.%Y", "2025-05-03"),
    ],
)
@pytest.mark.parametrize("zone", [None, BERLIN])
def test_an_unreadable_or_implausible_timestamp_is_bad(pattern, text, zone):
    times, status = utc_of([text], pattern, zone)
    assert status.tolist() == [Status.BAD_TIMESTAMP]
    assert np.isnan(times[0])


UNUSABLE = "use 'iso8601', 'epoch' or a strptime pattern"
PATTERNS = dict.fromkeys(("iso", "%H:%M:%S", "%d.%m.", "%Q", "%", "", "%Y-%m-%d %m"), UNUSABLE)


@pytest.mark.parametrize(
    ("pattern", "said"),
    [*PATTERNS.items(), ("%d.%m.%Y %I:%M", r"afternoons as mornings; use %H .* or add %p")],
)
def test_a_pattern_without_a_full_date_or_the_half_of_the_day_is_refused(pattern, said):
    with pytest.raises(SourceConfigError, match=said):
        timestamp_parser(pattern)


@pytest.mark.parametrize(
    ("zone", "change"),
    [
        ("Europe/Berlin", "2025-10-26T01:00:00"),
        ("Europe/Berlin", "2025-03-30T01:00:00"),
        ("America/New_York", "2025-11-02T06:00:00"),
        ("Australia/Lord_Howe", "2025-04-05T15:00:00"),  # half an hour back
        ("Atlantic/Azores", "2025-10-26T01:00:00"),  # back over midnight
        ("UTC", "2025-10-26T01:00:00"),
    ],
)
@pytest.mark.parametrize("cadence", [10.0, 60.0, 900.0])
@pytest.mark.parametrize("direction", [1, -1], ids=["oldest first", "newest first"])
def test_a_recording_over_a_clock_change_comes_back_as_it_was(zone, change, cadence, direction):
    utc = (seconds(change) + np.arange(-5 * 3600, 5 * 3600, cadence))[::direction]
    assert np.array_equal(local_to_utc(wall_clock(utc, ZoneInfo(zone)), ZoneInfo(zone)), utc)


@pytest.mark.parametrize(
    ("zone", "change", "step"),
    [
        ("Europe/Berlin", "2025-10-26T01:00:00", 3600.0),
        ("America/New_York", "2025-11-02T06:00:00", 3600.0),
        ("Australia/Lord_Howe", "2025-04-05T15:00:00", 1800.0),
        ("Atlantic/Azores", "2025-10-26T01:00:00", 3600.0),
    ],
)
@pytest.mark.parametrize("part", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("direction", [1, -1], ids=["oldest first", "newest first"])
@pytest.mark.parametrize("rows", [slice(None), slice(5, None), slice(None, 7)])
def test_one_record_in_each_pass_is_told_apart(zone, change, step, part, direction, rows):
    # The clock is set back between the records 5 and 6.
    utc = (seconds(change) + step * (part + np.arange(-6, 6)))[rows][::direction]
    assert np.array_equal(local_to_utc(wall_clock(utc, ZoneInfo(zone)), ZoneInfo(zone)), utc)


@pytest.mark.parametrize(
    "clocks",
    [
        "01:00 01:00 02:00 02:00 03:00 03:00",  # every row is written twice
        "01:00 02:00 02:00 03:00 03:00",
        "01:00 01:00 02:00 02:00 03:00",
        "01:30 02:00 02:00 03:00",  # a shorter step than an hour
        "01:00 02:15 02:15 03:00",
        "01:00 02:00 03:00 02:00",
        "01:00 02:00 02:00 02:00 03:00",
        "02:00 02:00",
    ],
)
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
