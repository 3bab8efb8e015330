"""Workers and samples that the tests of the worker, the snapshot and the zone share."""

import numpy as np

from adapters.reading import Quality
from estimator.network.presets import network
from estimator.registry import build
from service.records.sample import Sample
from service.zone.worker import WorkerSettings, ZoneWorker

PERIOD = 300
NAN = float("nan")


def worker(estimator="rbpf", preset="ecolar-6r4c", period=PERIOD, *, max_gap=3, hold_inputs=900.0, **options):
    """A worker that has seen nothing, with `options` of its estimator; by default few particles of an `rbpf`."""
    given = {"particles": 100} | options if estimator == "rbpf" else options
    made = build(estimator, network(preset), period, given)
    return ZoneWorker(made, WorkerSettings(5, (0.95, 0.5), max_gap, hold_inputs))


def sample(k, y=None, inputs=None, quality=Quality.GOOD):
    """Sample k: a slowly moving room, unless said otherwise."""
    values = np.array([5.0, 18.0, 600.0 * (k % 5 < 2)] if inputs is None else inputs)
    output = np.array([20 + 0.3 * np.sin(k / 9) if y is None else y])
    return Sample(
        k * PERIOD,
        output,
        values,
        tuple(Quality.BAD if np.isnan(v) else quality for v in output),
        tuple(Quality.BAD if np.isnan(v) else quality for v in values),
    )


def comparable(update):
    """An update without its wall time, in a form that tells NaN from a number and compares bit for bit."""
    return None if update is None else repr(update._replace(step_seconds=0.0))
