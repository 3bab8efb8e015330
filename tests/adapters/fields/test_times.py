from datetime import UTC, datetime, timedelta, timezone

import pytest

from adapters.fields.times import ZoneMissing, parse_time, utc, written_day, written_time, written_to_the_millisecond

NOON = datetime(2025, 5, 3, 12, tzinfo=UTC)


@pytest.mark.parametrize("text", ["2025-05-03T12:00:00Z", "2025-05-03T14:00:00+02:00", "2025-05-03 12:00Z"])
def test_a_time_is_read_into_utc(text):
    assert (parse_time(text), parse_time(text).tzinfo) == (NOON, UTC)


NO_TIMES = ["", "noon", "12:00Z", "2025-13-03T12:00:00Z", "0001-01-01T00:00:00+23:00"]


@pytest.mark.parametrize("text", [*NO_TIMES, "2025-05-03T12:00:00", "2025-05-03"])
def test_a_time_without_a_zone_is_a_mistake_of_its_own(text):
    with pytest.raises(ValueError) as caught:
        parse_time(text)
    assert isinstance(caught.value, ZoneMissing) == (text not in NO_TIMES)


def test_times_are_written_in_utc():
    berlin = NOON.astimezone(timezone(timedelta(hours=2)))
    assert written_time(berlin) == written_time(NOON.timestamp()) == "2025-05-03T12:00:00Z"
    assert written_time(NOON.timestamp() + 0.9999997) == "2025-05-03T12:00:00Z"
    assert written_time(-0.5) == "1969-12-31T23:59:59Z"
    assert written_to_the_millisecond(NOON.timestamp() + 0.25) == "2025-05-03T12:00:00.250Z"
    assert written_day(datetime(2025, 5, 4, 1, tzinfo=timezone(timedelta(hours=2)))) == "2025-05-03"
    assert utc(NOON.timestamp()) == NOON
