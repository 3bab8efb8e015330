"""What a zone's model does not know: found while it runs, kept in its checkpoint, missing in an old one."""

import pytest
from support.zone_samples import NAN, PERIOD, sample, worker

from estimator import loop as loop_module
from estimator.diagnosis.diagnose import EVERY
from estimator.diagnosis.finding import Diagnosis, Finding

STEPS = EVERY // PERIOD


def fed(steps):
    """A zone with an estimator that is quick."""
    zone = worker("ekf", "tite")
    for k in range(steps):
        zone.step(sample(k, inputs=[5.0, 600.0 * (k % 5 < 2)]))
    return zone


@pytest.fixture
def counted(monkeypatch):
    calls = []

    def counting(*given, **named):
        calls.append(given)
        return Diagnosis((Finding("forecast-implausible", "zone", f"number {len(calls)}; wait"),))

    monkeypatch.setattr(loop_module, "diagnose", counting)
    return calls


def test_a_diagnosis_is_made_every_few_hours_of_samples(counted):
    zone = fed(3 * STEPS)
    assert len(counted) == 3 + 1, "and once at the first heating"
    assert zone.carried.diagnosis.findings[0].sentence == "number 4; wait"


def test_a_sample_without_a_temperature_leaves_no_sum_and_a_stall_nothing(counted):
    zone = fed(10)
    before = zone.carried.record
    zone.step(sample(10, y=NAN, inputs=[5.0, 0.0]))
    assert (zone.carried.record.seconds == before.seconds).all()
    for k in range(11, 16):
        zone.step(sample(k, y=NAN, inputs=[5.0, 0.0]))
    assert zone.progress.stalled
    assert (zone.carried.record.seconds == before.seconds).all()
