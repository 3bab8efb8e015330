"""The load generator on the real daemon, small, and what it makes of what it saw."""

import json
import subprocess
import sys

import pytest

from replay.errors import MeasurementError
from replay.lab.measuring.fleet import measures
from replay.lab.measuring.fleet.clients import Answer
from replay.lab.measuring.fleet.report import lines
from replay.lab.measuring.fleet.run import run
from replay.lab.measuring.fleet.scenario import LONE_ROUNDS, Scenario, write, zone_ids
from replay.simulated.semi_synthetic import PERIOD
from service.config.load import load


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    scenario = Scenario(zones=20, particles=60, preset="building-67", every=0.5, rounds=3)
    return run(scenario, tmp_path_factory.mktemp("fleet"), clients=2, pause=0.01)


def test_every_forecast_of_every_zone_and_instant_is_heard(result):
    assert [one["forecasts"] for one in result["rounds"]] == [20, 20, 20]
    assert result["missing_forecasts"] == 0
    for one in result["rounds"]:
        assert one["first_s"] <= one["median_s"] <= one["last_s"]


def test_clients_are_answered_and_the_event_loop_is_watched(result):
    rest = result["rest"]
    asked = rest["during_bursts"]["requests"] + rest["between_bursts"]["requests"]
    assert asked > 0
    assert rest["during_bursts"]["not_ok"] + rest["between_bursts"]["not_ok"] == 0
    assert result["event_loop"]["timers"] > 0
    assert result["resident_bytes"] > 50e6
    assert result["cpu_seconds_per_round"] > 0


def test_the_figures_read_as_lines(result):
    text = "\n".join(lines(result))
    assert "0 forecasts missing" in text
    assert "GB" in text
    json.dumps(result)


def test_only_the_first_zone_has_the_lone_intervals(tmp_path):
    scenario = Scenario(zones=3, particles=60, preset="titeth", every=1.0, rounds=2)
    config = load(write(scenario, tmp_path, 7447))
    assert [zone.id for zone in config.zones] == zone_ids(3)
    rows = [line.split(",") for line in (tmp_path / "fleet.csv").read_text().splitlines()[1:]]
    assert len(rows) == scenario.rows
    first, others = slice(1, 4), slice(4, None)
    assert all(all(row[first]) for row in rows)
    assert not any(any(row[others]) for row in rows[:LONE_ROUNDS])
    assert all(all(row[others]) for row in rows[LONE_ROUNDS:])
    assert config.sources["recording"].pace == PERIOD / scenario.every


def test_a_network_that_the_recording_cannot_feed_is_refused(tmp_path):
    with pytest.raises(MeasurementError, match="needs the channel T_air"):
        write(Scenario(1, 60, "m1", 1.0, 1), tmp_path, 7447)


def test_instants_are_those_of_the_quickest_lone_forecast():
    every, start = 2.0, 1000.0
    scenario = Scenario(2, 60, "building-67", every, 1)
    arrivals = {PERIOD * k: {"zone-0000": start + (k + 1) * every + delay} for k, delay in enumerate((0.3, 0.01, 0.2))}
    for k in (3, 4):
        arrivals[PERIOD * k] = dict.fromkeys(("zone-0000", "zone-0001"), start + (k + 1) * every + 0.5)
    assert measures.origin(arrivals, every) == pytest.approx(start + 0.01)
    (measured,) = measures.rounds(arrivals, scenario)
    assert measured["last_s"] == pytest.approx(0.49)
    del arrivals[PERIOD * 4]["zone-0001"]
    assert measures.rounds(arrivals, scenario)[0]["missing"] == 1


def test_answers_are_told_apart_by_the_bursts():
    bursts = [{"instant": 10.0, "last_s": 1.0}, {"instant": 20.0, "last_s": None}]
    answers = [
        Answer("forecast", 9.9, 10.1, 200),
        Answer("zone", 12.0, 12.5, 503),
        Answer("metrics", 10.2, 10.9, 200),
    ]
    found = measures.latencies(answers, bursts)
    assert found["during_bursts"] == pytest.approx(
        {"requests": 1, "not_ok": 0, "p50_s": 0.2, "p99_s": 0.2, "max_s": 0.2}
    )
    assert found["between_bursts"]["not_ok"] == 1
    assert found["endpoints_during_bursts"].keys() == {"forecast", "metrics"}


def test_loop_delays_are_the_difference_of_two_scrapes():
    line = 'thermogate_event_loop_delay_seconds_bucket{{le="{}"}} {}'
    before = measures.delay_buckets("\n".join(line.format(bound, 5) for bound in ("0.01", "0.02", "0.05", "+Inf")))
    after = measures.delay_buckets(
        "\n".join(line.format(bound, count) for bound, count in (("0.01", 8), ("0.02", 9), ("0.05", 10), ("+Inf", 10)))
    )
    found = measures.loop_delays(before, after)
    assert (found["timers"], found["later_than_20_ms"], found["none_later_than_s"]) == (5, 1, 0.05)


def test_a_daemon_that_cannot_start_is_said_in_one_sentence(tmp_path):
    command = [
        sys.executable,
        "-m",
        "replay.lab.measuring.fleet",
        "--network",
        "m1",
        "--zones",
        "1",
        "--out",
        str(tmp_path / "out"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("fleet: network 'm1'")
    assert len(done.stderr.splitlines()) == 1
