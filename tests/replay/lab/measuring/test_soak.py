"""The soak and the overload on the real daemon, for a few seconds, and what is made of what they saw."""

import json

import pytest

from replay.lab.measuring import overload
from replay.lab.measuring.daemon import Observation
from replay.lab.measuring.soak import LIMITS, Soak, judge, lines, run, summary


def observed(count=120, **growth):
    """`count` looks 2 s apart at pace 600; `growth` per simulated day of some figures, on a ripple."""
    usual = {"resident_mb": 300.0, "descriptors": 40, "threads": 18, "disk_mb": 5.0}
    looks = []
    for k in range(count):
        days = 2.0 * k * 600.0 / 86_400.0
        ripple = {"resident_mb": 0.2 * (k % 5), "descriptors": k % 3, "threads": k % 2, "disk_mb": 0.001 * k}
        values = {name: value + ripple[name] + growth.get(name, 0.0) * days for name, value in usual.items()}
        looks.append(Observation(2.0 * k, cpu_s=0.1 * k, samples=12 * k, timers=100.0 * k,
                                 late_timers=0.5 * k, overruns=0.0, **values))  # fmt: skip
    return looks


def test_what_stays_level_is_within_its_limits():
    assert all(one.within for one in judge(observed(), 600.0))
    found = summary(observed(), 600.0)
    assert found["simulated_hours"] == pytest.approx(2.0 * 119 * 600 / 3600)
    assert found["late_timers_share"] == pytest.approx(0.005)
    assert found["cores_used"] == pytest.approx(0.05)


@pytest.mark.parametrize("figure", [limit.figure for limit in LIMITS])
def test_what_grows_is_found(figure):
    verdicts = {one.limit.figure: one for one in judge(observed(**{figure: 5.0}), 600.0)}
    assert [name for name, one in verdicts.items() if not one.within] == [figure]
    if figure != "disk_mb":
        assert verdicts[figure].slope == pytest.approx(5.0, abs=0.2)


def test_a_peak_is_no_growth():
    looks = observed()
    looks[-3:] = [one._replace(resident_mb=900.0) for one in looks[-3:]]
    assert all(one.within for one in judge(looks, 600.0))


def test_what_was_taken_before_the_clock_ran_does_not_count():
    # 20,000 samples, 2,000 of them taken before, one a millisecond offered for 90 s.
    assert overload.factor(20_000 - 2000, 90.0, 0.001) == pytest.approx(5.0)


def test_the_real_daemon_is_watched_in_company(tmp_path):
    soak = Soak(hours=2.0, pace=600.0, zones=2, particles=60, every=0.5, streams=3, clients=1)
    result, observations = run(soak, tmp_path / "soak")
    assert len(observations) > 10
    assert observations[-1].samples > observations[0].samples
    assert observations[-1].disk_mb > 0
    assert observations[-1].timers > observations[0].timers
    company = result["company"]
    assert company["streams"] >= 3
    assert company["requests"] > 5
    assert company["not_answered"] == 0
    text = lines(json.loads(json.dumps(result)), judge(observations, 600.0))
    assert "simulated hours" in text[0]
    assert sum("limit" in line for line in text) == len(LIMITS)


def test_ten_times_too_much_loses_nothing(tmp_path):
    polled = overload.readings(tmp_path / "readings", 6.0, particles=60)
    offered = overload.samples(tmp_path / "samples", 300, particles=2000, every=0.0001)
    assert offered["factor"] > 1.0
    assert offered["lost"] == offered["out_of_order"] == offered["rest"]["not_ok"] == 0
    assert offered["overruns"] > 0
    assert polled["requests_without_answer"] == 0
    assert polled["samples"] > 0
    assert len(overload.lines(polled, json.loads(json.dumps(offered)))) == 2
