"""The soak on the real daemon, for a few seconds, and what is made of what it saw."""

from dataclasses import replace

import pytest
from integration.soak import LIMITS, Soaked, soak
from support.observed import Observation


def seen(**growth: float) -> Soaked:
    """120 looks 2 s apart at pace 600; `growth` per simulated day of some figures, on a ripple."""
    usual, looks = {"resident_mb": 300.0, "descriptors": 40, "threads": 18, "disk_mb": 5.0}, []
    for k in range(120):
        days = 2.0 * k * 600.0 / 86_400.0
        ripple = {"resident_mb": 0.2 * (k % 5), "descriptors": k % 3, "threads": k % 2, "disk_mb": 0.001 * k}
        values = {name: value + ripple[name] + growth.get(name, 0.0) * days for name, value in usual.items()}
        looks.append(Observation(elapsed=2.0 * k, samples=12 * k, overruns=0.0, **values))
    return Soaked(600.0, looks, {})


def test_what_grows_is_found_and_a_peak_is_no_growth() -> None:
    assert seen().good
    for limit in LIMITS:
        found = seen(**{limit.figure: 5.0})
        assert found.exceeded() == [limit.figure]
        if limit.figure != "disk_mb":
            assert found.slopes()[limit][0] == pytest.approx(5.0, abs=0.2)
    peak = seen()
    peak.observations[-3:] = [replace(one, resident_mb=900.0) for one in peak.observations[-3:]]
    assert peak.good


def test_the_real_daemon_is_watched_in_company() -> None:
    found = soak(1.0, 600.0, 2, particles=60, every=0.4)
    first, last = found.observations[0], found.observations[-1]
    assert len(found.observations) > 10
    assert last.samples > first.samples
    assert last.disk_mb > 0
    assert found.company["streams"] >= 3
    assert found.company["requests"] > 5
    assert found.company["not_answered"] == 0
    assert "simulated hours" in found.lines()[0]
