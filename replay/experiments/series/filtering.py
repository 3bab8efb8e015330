"""One estimator over one series: the loop of every experiment, and the trace it leaves."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from estimator import registry
from estimator.arrays import Array
from estimator.gaussian.floor import floor
from estimator.network.network import Network
from estimator.types import Estimator, Mixture, Posterior
from replay.experiments.jobs import Arrays, Job, Tick
from replay.localtime import Seconds
from replay.scores.intervals import LEVEL, Mask
from service.zone.worker import VANISHED_LIMIT, lost

REGIMES = ("low", "transitional", "high")
"""Volatility regimes; the trace holds their places in this tuple, -1 where an estimator has none."""

FLOOR = "floor"


class Series(NamedTuple):
    """Samples without a missing value: UTC s (K,), outputs (K, n_y) and inputs (K, n_u) in the network's order.

    `starts` (K,) marks the samples that begin a segment: the first, and each one after a gap.
    """

    times: Seconds
    outputs: Array
    inputs: Array
    starts: Mask


class FilterRun(NamedTuple):
    """What a run of an estimator depends on; `period` in s, `options` as in the configuration.

    The estimator "floor" takes the keyword arguments of `estimator.gaussian.floor.floor` instead.
    """

    estimator: str
    options: Mapping[str, object]
    network: Network
    period: float
    series: Series
    seed: int


class Trace(NamedTuple):
    """What an estimator said of its first output along K samples, degC and K; NaN where it said nothing.

    `mean`, `lower`, `upper` and `pit` are `one_step`: formed before y_k was seen. The `filtered_...` ones are of the
    measured state after y_k, without measurement noise.
    """

    mean: Array
    lower: Array
    upper: Array
    pit: Array
    """F_k(y_k), the probability integral transform."""
    filtered_mean: Array
    filtered_lower: Array
    filtered_upper: Array
    alpha: Array
    """(K, 3): .025, .5 and .975 quantiles of alpha_k, of the block that trusts its model least."""
    gate: Array
    regime: npt.NDArray[np.int8]
    """Place in REGIMES after y_k."""
    effective_sample_size: Array
    log_likelihood: Array
    theta: Array
    """(K, n_theta): point estimates after y_k."""
    seconds: Array
    """Wall time of the step."""


def filter_job(label: str, run: FilterRun) -> Job:
    """The job of `run`."""
    return Job(label, run.seed, run_filter, run, len(run.series.times))


def run_filter(run: FilterRun, tick: Tick) -> Arrays:
    """The arrays of a `Trace`."""
    if run.estimator == FLOOR:
        options = run.options
        estimator: Estimator = floor(run.network, run.period, **options)  # type: ignore[arg-type]
    else:
        resolved = registry.resolve(run.estimator, run.network, run.period, run.options)
        options = registry.as_mapping(resolved)
        estimator = registry.construct(run.estimator, run.network, run.period, resolved)
    noise = float(options["measurement_sd"])  # type: ignore[arg-type]
    return trace(estimator, run.series, run.seed, noise, tick)._asdict()


def trace(estimator: Estimator, series: Series, seed: int, measurement_sd: float, tick: Tick) -> Trace:
    """Predict, score, assimilate: every sample of `series` as the zone worker takes it.

    The first sample of a segment starts the states at y and is not assimilated.
    """
    samples, tails = len(series.times), np.array([0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
    kept = _blank(samples, len(estimator.network.parameters))
    unmeasured = np.full(series.outputs.shape[1], np.nan)
    state, vanished = None, 0
    for k in range(samples):
        began = time.perf_counter()
        y, inputs = series.outputs[k], series.inputs[k]
        if state is not None and not series.starts[k]:
            standing = estimator.predictive(state)
            kept.mean[k] = standing.mean()[0]
            kept.lower[k], kept.upper[k] = estimator.quantiles(standing, tails, 0)
            kept.pit[k] = standing.weights @ ndtr((y[0] - standing.means[0]) / standing.sds[0])
            posterior = estimator.update(state, y)
            vanished = vanished + 1 if lost(posterior.outcome, standing.sd()) else 0
        if state is None or series.starts[k] or vanished >= VANISHED_LIMIT:
            state = estimator.start(seed, y, inputs) if state is None else estimator.restart(state, y, inputs)
            posterior, vanished = estimator.update(state, unmeasured), 0
        else:
            after = _without_noise(estimator.predictive(posterior.state), measurement_sd)
            kept.filtered_mean[k] = after.mean()[0]
            kept.filtered_lower[k], kept.filtered_upper[k] = estimator.quantiles(after, tails, 0)
        _keep(kept, k, posterior)
        state = estimator.predict(posterior.state, inputs)
        kept.seconds[k] = time.perf_counter() - began
        tick(1)
    return kept


def _blank(samples: int, parameters: int) -> Trace:
    columns = {name: np.full(samples, np.nan) for name in Trace._fields}
    columns["alpha"] = np.full((samples, 3), np.nan)
    columns["theta"] = np.full((samples, parameters), np.nan)
    return Trace(**columns)._replace(regime=np.full(samples, -1, dtype=np.int8))


def _keep(kept: Trace, k: int, posterior: Posterior) -> None:
    if len(posterior.alpha_quantiles):
        kept.alpha[k] = posterior.alpha_quantiles[np.argmax(posterior.alpha_quantiles[:, 1])]
    if posterior.regime is not None:
        kept.regime[k] = REGIMES.index(posterior.regime)
    if posterior.gate is not None:
        kept.gate[k] = posterior.gate
    if posterior.effective_sample_size is not None:
        kept.effective_sample_size[k] = posterior.effective_sample_size
    kept.log_likelihood[k] = posterior.log_likelihood
    kept.theta[k] = posterior.parameters


def _without_noise(mixture: Mixture, measurement_sd: float) -> Mixture:
    """The mixture of the state behind the outputs."""
    variance = np.maximum(mixture.sds**2 - measurement_sd**2, np.finfo(float).tiny)
    return mixture._replace(sds=np.sqrt(variance))
