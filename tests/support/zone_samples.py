"""Workers and samples that the tests of the worker, the snapshot and the zone share."""

import numpy as np

from adapters.reading import Quality
from estimator.network.presets import network
from estimator.registry import build
from service.records.sample import Sample
from service.zone.worker import WorkerSettings, ZoneWorker

PERIOD = 300
NAN = float("nan")


def worker(estimator="rbpf", of="ecolar-6r4c", period=PERIOD, *, max_gap=3, hold_inputs=900.0, known=None, **options):
    """A worker of a preset or network that has seen nothing, with `options` of its estimator (`rbpf`: few particles).

    `known`: what the worker is told of its surroundings.
    """
    given = {"particles": 100} | options if estimator == "rbpf" else options
    made = build(estimator, network(of) if isinstance(of, str) else of, period, given)
    return ZoneWorker(made, WorkerSettings(5, (0.95, 0.5), max_gap, hold_inputs), **(known or {}))


def fed(one, seen):
    """The worker after all samples of `seen`."""
    for item in seen:
        one.step(item)
    return one


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
