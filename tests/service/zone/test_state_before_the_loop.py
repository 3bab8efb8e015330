"""A checkpoint that the worker wrote before its loop was one of its own (`estimator/loop.py`) is resumed.

The archive holds, for each estimator, the checkpoint in the middle of `story` and the numbers that the worker of that
version published for the rest of it.
"""

import json
import tarfile
from pathlib import Path

import numpy as np
import pytest

from adapters.reading import Quality
from estimator.network.presets import network
from estimator.registry import build
from service.records.record import values
from service.records.sample import Sample
from service.store.checkpoint import CheckpointStore
from service.zone import snapshot
from service.zone.worker import WorkerSettings, ZoneWorker

ARCHIVE = Path(__file__).with_name("state-before-the-loop.tar.xz")
PERIOD = 600
NAN = float("nan")
MEMBERS = {
    "steady": {"estimator": "ekf"},
    "free": {"estimator": "mkf", "particles": 8},
    "arx": {"estimator": "arx"},
}
ESTIMATORS = {"ekf": {}, "bank": {"members": MEMBERS}}
STOP = 206
TOLERANCE = {"ekf": 1e-7, "bank": 0.1}
"""Relative. Between processors of another kind the last digits may differ, and a filter carries them on. A bank has
since learned to hold its members close to their median, so what it publishes is near and not the same."""


def worker(estimator):
    made = build(estimator, network("tite"), PERIOD, ESTIMATORS[estimator])
    return ZoneWorker(made, WorkerSettings(5, (0.95, 0.5), 3, 1800.0))


def sample(k, y=None, heat=None):
    outputs = np.array([20.0 + 0.3 * np.sin(k / 9) if y is None else y])
    heating = 600.0 * (k % 5 < 2) if heat is None else heat
    inputs = np.array([5.0 + 4.0 * np.sin(2 * np.pi * k / 144), heating])
    quality = (tuple(Quality.BAD if np.isnan(v) else Quality.GOOD for v in values) for values in (outputs, inputs))
    return Sample(8_640_000 + k * PERIOD, outputs, inputs, *quality)


def story():
    """Plain running, a bridged gap, an outlier, an input that is held; then a stall, a gap and a sensor that is moved.

    The checkpoint is taken while an outlier has just passed and an input is held.
    """
    steps = [sample(k) for k in range(200)]
    steps += [sample(k, y=NAN) for k in range(200, 203)]
    steps += [sample(203), sample(204, y=99.0), sample(205, heat=NAN)]
    steps += [sample(k, heat=NAN) for k in range(206, 212)]
    steps += [sample(k) for k in (*range(212, 260), *range(262, 300))]
    return steps + [sample(k, y=5.0) for k in range(300, 330)]


def numbers(update):
    """What is published of an update, without its wall time."""
    if update is None:
        return None
    (output,) = update.forecast.outputs
    bounds = [bound for interval in output.intervals for bound in (interval.lower, interval.upper)]
    head = [update.time, update.segment, update.outcome, output.mean, output.median, output.sd, *bounds]
    return head + list(update.parameters)


def skills(zone):
    """What the forecasts of a week were worth, horizon by horizon."""
    return [list(map(float, values(one)[:8])) for one in zone.skill().over(7)]


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_the_worker_of_today_goes_on(estimator, tmp_path):
    with tarfile.open(ARCHIVE) as archive:
        archive.extractall(tmp_path, filter="data")
    expected = json.loads((tmp_path / f"{estimator}.json").read_text(encoding="utf-8"))
    checkpoint = CheckpointStore(tmp_path / "checkpoints").load(estimator, "mark")
    zone = worker(estimator)
    snapshot.restore(zone, checkpoint)
    assert zone.progress.samples == STOP
    found = [numbers(zone.step(item)) for item in story()[STOP:]]
    assert [one is None for one in found] == [one is None for one in expected["updates"]]
    for one, other in zip(filter(None, found), filter(None, expected["updates"]), strict=True):
        assert one[:3] == other[:3]
        np.testing.assert_allclose(one[3:], other[3:], rtol=TOLERANCE[estimator])
    assert {row[2] for row in found if row} == {"started", "assimilated", "vanished"}
    np.testing.assert_allclose(skills(zone), expected["skill"], rtol=max(1e-5, TOLERANCE[estimator]))


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_what_is_written_has_the_same_arrays(estimator, tmp_path):
    with tarfile.open(ARCHIVE) as archive:
        archive.extractall(tmp_path, filter="data")
    before = CheckpointStore(tmp_path / "checkpoints").load(estimator, "mark")
    zone = worker(estimator)
    snapshot.restore(zone, before)
    after = snapshot.take(zone, "mark", estimator)
    for name, value in before.arrays.items():
        if (estimator, name) == ("bank", "estimator.pending.note"):
            # What a bank notes of a forecast has come to be more since.
            continue
        assert after.arrays[name].dtype == value.dtype
        assert after.arrays[name].tobytes() == value.tobytes(), name
    # Trust has come to know more of each horizon, which is written after what it knew.
    assert [one[:7] for one in after.meta["trust"][1]] == before.meta["trust"][1]
    for name, value in before.meta.items():
        assert name == "trust" or repr(after.meta[name]) == repr(value)
