"""The load generator on the real daemon, small, and what it makes of what it saw."""

import pytest

from replay.errors import MeasurementError
from replay.lab.measuring import daemon
from replay.lab.measuring.clients import Answer
from replay.lab.measuring.fleet import latencies, rounds, run
from replay.lab.measuring.scenario import Scenario, write


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    scenario = Scenario(zones=20, particles=60, preset="building-67", every=0.5, rounds=3)
    return run(scenario, tmp_path_factory.mktemp("fleet"), clients=2, pause=0.01)


def test_every_forecast_of_every_zone_and_instant_is_heard(result):
    assert len(result["rounds"]) == 3
    assert result["missing_forecasts"] == 0
    assert all(0.0 <= one["median_s"] <= one["last_s"] for one in result["rounds"])


def test_clients_are_answered_and_the_event_loop_is_watched(result):
    rest = result["rest"]
    assert rest["during_bursts"]["not_ok"] == 0
    assert result["event_loop"]["timers"] > 0
    assert result["resident_bytes"] > 50e6


def test_an_instant_counts_from_its_first_forecast():
    scenario = Scenario(2, 60, "building-67", 2.0, 2)
    arrivals = {0.0: {"a": 9.0, "b": 9.1}, 600.0: {"a": 11.0, "b": 11.5}, 1200.0: {"b": 13.0}, 1800.0: {"a": 15.0}}
    first, second = rounds(arrivals, scenario)
    assert (first["instant"], first["last_s"], first["missing"]) == (11.0, 0.5, 0)
    assert second["missing"] == 1
    assert [one["missing"] for one in rounds({0.0: {}}, scenario)] == [2, 2]


def test_answers_are_told_apart_by_the_bursts():
    bursts = [{"instant": 10.0, "last_s": 1.0}, {"instant": None, "last_s": None}]
    answers = [
        Answer("forecast", 9.9, 10.1, 200),
        Answer("zone", 12.0, 12.5, 503),
        Answer("metrics", 10.2, 10.9, 200),
    ]
    found = latencies(answers, bursts)
    assert found["during_bursts"] == pytest.approx(
        {"requests": 1, "not_ok": 0, "p50_s": 0.2, "p99_s": 0.2, "max_s": 0.2}
    )
    assert found["endpoints_during_bursts"].keys() == {"forecast", "metrics"}


def test_loop_delays_are_the_difference_of_two_scrapes():
    line = 'thermogate_event_loop_delay_seconds_bucket{{le="{}"}} {}'
    before, after = (
        daemon.delay_buckets("\n".join(line.format(bound, count) for bound, count in counts))
        for counts in (
            [(bound, 5) for bound in ("0.01", "0.02", "0.05", "+Inf")],
            [("0.01", 8), ("0.02", 9), ("0.05", 10), ("+Inf", 10)],
        )
    )
    found = daemon.loop_delays(before, after)
    assert (found["timers"], found["later_than_20_ms"], found["none_later_than_s"]) == (5, 1, 0.05)


def test_a_network_that_the_recording_cannot_feed_is_refused(tmp_path):
    with pytest.raises(MeasurementError, match="network 'm1' needs the channel T_air"):
        write(Scenario(1, 60, "m1", 1.0, 1), tmp_path)
