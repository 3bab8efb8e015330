"""What is timed: complete updates of the particle filter on the dynamics of building 67."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from estimator.arrays import Array
from estimator.network.presets import building_67
from estimator.particle.options import resolve
from estimator.particle.rbpf import RBPF
from replay.simulated import semi_synthetic
from replay.simulated.semi_synthetic import PERIOD

TAILS = np.array([0.5, 0.025, 0.975])
"""Levels of the published median and of the interval at .95."""

_DAYS = 20

Result = TypeVar("Result")


class Samples(NamedTuple):
    """A simulated period: outputs (K, 1) and inputs (K, 3) of building 67."""

    outputs: Array
    inputs: Array

    def at(self, index: int) -> tuple[Array, Array]:
        """Outputs and inputs of sample `index`, from the beginning again after the last."""
        row = index % len(self.outputs)
        return self.outputs[row], self.inputs[row]


def samples() -> Samples:
    """Samples with heating, sun and an unmeasured gain, so that resampling happens as often as it does in use."""
    recording = semi_synthetic.generate(None, days=_DAYS, seed=1)
    network = building_67()

    def rows(channels: Sequence[str]) -> Array:
        return np.column_stack([recording.columns[channel] for channel in channels])

    return Samples(rows(network.measured), rows(network.inputs))


def build(particles: int, options: Mapping[str, object] | None = None) -> RBPF:
    """The filter of building 67, all ten parameters free, with the default options and what `options` changes."""
    network, given = building_67(), {"particles": particles, **(options or {})}
    return RBPF(network, PERIOD, resolve(network, PERIOD, given))


class Step(NamedTuple):
    """What one complete update leaves: the next state, the published quantiles (3,), whether it resampled."""

    state: Any
    quantiles: Array
    resampled: bool


def complete_update(estimator: RBPF, state: Any, outputs: Array, inputs: Array) -> Step:
    """All that a zone's worker has its estimator do with one sample.

    Weights, measurement update, gate, resampling when due and rejuvenation; volatility, zero-order hold and Kalman
    prediction to the next sample; mean, spread, median and interval of its forecast.
    """
    posterior = estimator.update(state, outputs)
    state = estimator.predict(posterior.state, inputs)
    mixture = estimator.predictive(state)
    mixture.mean(), mixture.sd()
    return Step(state, estimator.quantiles(mixture, TAILS, 0), posterior.resampled)


def settled(estimator: RBPF, given: Samples, steps: int, seed: int = 1) -> Any:
    """The filter's state after `steps` samples."""
    outputs, inputs = given.at(0)
    state = estimator.predict(estimator.start(seed, outputs, inputs), inputs)
    for index in range(1, steps):
        state = complete_update(estimator, state, *given.at(index)).state
    return state


def timed(work: Callable[[], Result]) -> tuple[float, Result]:
    """Seconds that `work` takes, and what it returns."""
    began = time.perf_counter()
    result = work()
    return time.perf_counter() - began, result


def spread(seconds: list[float]) -> dict[str, float]:
    """Median and quartiles in s, and how many there were."""
    lower, median, upper = np.quantile(seconds, (0.25, 0.5, 0.75)).tolist()
    return {"median_s": median, "lower_quartile_s": lower, "upper_quartile_s": upper, "repeats": len(seconds)}


def pin_to_one_processor() -> None:
    """Keep this process, libraries' threads included, on a single processor: the first that it may use."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def slope(sizes: list[float], values: list[float]) -> float:
    """Exponent p of values ~ sizes^p, by least squares on logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])
