"""The load generator on the real daemon, small, and what it makes of what it saw."""

import pytest

from replay.lab.measuring.clients import Answer, summary
from replay.lab.measuring.daemon import loop_delays
from replay.lab.measuring.fleet import Round, during, rounds, run
from replay.lab.measuring.scenario import Scenario


def test_every_forecast_is_heard_and_clients_are_answered(tmp_path):
    scenario = Scenario(zones=20, particles=60, preset="building-67", every=0.5, rounds=3)
    result = run(scenario, tmp_path, clients=2, pause=0.01)
    assert result["missing_forecasts"] == 0
    assert result["last_forecast_s"] >= 0.0
    assert result["rest"]["not_ok"] == 0
    assert result["event_loop"]["timers"] > 0
    assert result["resident_bytes"] > 50e6


def test_an_instant_counts_from_its_first_forecast():
    scenario = Scenario(2, 60, "building-67", 2.0, 2)
    arrivals = {0.0: {"a": 9.0, "b": 9.1}, 600.0: {"a": 11.0, "b": 11.5}, 1200.0: {"b": 13.0}, 1800.0: {"a": 15.0}}
    assert rounds(arrivals, scenario) == [Round(11.0, 11.5, 0), Round(13.0, 13.0, 1)]
    assert rounds({0.0: {}}, scenario) == []


def test_answers_are_told_apart_by_the_bursts():
    answers = [
        Answer("forecast", 9.9, 10.1, 200),
        Answer("zone", 12.0, 12.5, 503),
        Answer("metrics", 10.2, 10.9, 200),
    ]
    found = summary(during(answers, [Round(10.0, 11.0, 0)]))
    assert found == pytest.approx({"requests": 1, "not_ok": 0, "p99_s": 0.2, "max_s": 0.2})


def test_loop_delays_are_the_difference_of_two_scrapes():
    name = "thermogate_event_loop_delay_seconds_bucket "
    before, after = (
        {f"{name}{bound}": count for bound, count in zip(("0.01", "0.02", "0.05", "inf"), counts, strict=True)}
        for counts in ((5.0,) * 4, (8.0, 9.0, 10.0, 10.0))
    )
    assert loop_delays(before, after) == {"timers": 5.0, "late": 1.0, "none_later_than_s": 0.05}
