"""One estimator over one series: the zone's loop as every experiment runs it, and the trace it leaves."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from estimator import registry
from estimator.arrays import Array
from estimator.gaussian.floor import floor
from estimator.heat.known import KnownHeat
from estimator.loop import Carried, Loop
from estimator.neighbours import Experience
from estimator.network.network import Network
from estimator.types import Disturbance, Estimator, Mixture, Posterior
from replay.experiments.jobs import Arrays
from replay.localtime import Seconds
from replay.scores.intervals import LEVEL, Mask
from service.config.fitting import known_heat
from service.config.site import Whereabouts

FLOOR = "floor"
TAILS = np.array([0.5 - LEVEL / 2, 0.5 + LEVEL / 2])


class Series(NamedTuple):
    """Samples one period apart: UTC s (K,), outputs (K, n_y), NaN where nothing was measured, and complete inputs (K,
    n_u) in the network's order. `starts` (K,) marks those that begin a segment, with a measured output. `setpoints`
    (K,) [degC] are NaN where nobody says; None where nobody ever does."""

    times: Seconds
    outputs: Array
    inputs: Array
    starts: Mask
    setpoints: Array | None = None

    def rows(self, which: slice | Mask) -> Series:
        """The series of those rows, the first of which begins a segment."""
        setpoints = None if self.setpoints is None else self.setpoints[which]
        return Series(self.times[which], self.outputs[which], self.inputs[which], self.starts[which], setpoints)


class FilterRun(NamedTuple):
    """What a run of an estimator depends on; `period` in s, `options` as in the configuration, of the estimator "floor"
    the keyword arguments of `estimator.gaussian.floor.floor`."""

    estimator: str
    options: Mapping[str, object]
    network: Network
    period: float
    series: Series
    seed: int
    whereabouts: Whereabouts = Whereabouts()
    """What heat that is known up to coefficients depends on, of a network with terms."""
    leads: tuple[int, ...] = ()
    """Steps ahead at which forecasts are kept, where hours ahead are forecast."""
    experience: Experience | None = None
    """What it begins with."""


class Trace(NamedTuple):
    """What an estimator said of its first output along K samples, degC and K, or NaN: `mean`, `lower` and `upper`
    before y_k was seen, the `filtered_...` ones of the state after it (`run_filter`)."""

    mean: Array
    lower: Array
    upper: Array
    filtered_mean: Array
    filtered_lower: Array
    filtered_upper: Array
    alpha: Array
    """(K, 3): .025, .5 and .975 quantiles of alpha_k, of the block that trusts its model least."""
    gate: Array
    theta: Array
    """(K, n_theta): point estimates after y_k."""
    seconds: Array
    """Wall time of the step."""


class Step(NamedTuple):
    """One sample of a series, taken by an estimator."""

    row: int
    standing: Mixture | None
    """The forecast of y_k that was formed before y_k was seen; None where a segment begins."""
    posterior: Posterior
    disturbance: Callable[[], Disturbance] | None
    """Of the step that ended with the sample; None for an estimator without a model of it."""
    assimilated: bool
    """Whether y_k was given to the filter; otherwise its states began anew at y_k."""
    carried: Carried

    @property
    def state(self) -> Any:
        """The estimator's, predicted to the next sample."""
        assert self.carried.standing is not None
        return self.carried.standing.state


def built(run: FilterRun) -> tuple[Estimator, KnownHeat | None, object]:
    """The estimator of `run`, the heat that its network knows, and its option `measurement_sd`, if it has one."""
    if run.estimator == FLOOR:
        options = run.options
        estimator: Estimator = floor(run.network, run.period, **options)  # type: ignore[arg-type]
    else:
        resolved = registry.resolve(run.estimator, run.network, run.period, run.options)
        options = registry.as_mapping(resolved)
        estimator = registry.construct(run.estimator, run.network, run.period, resolved)
    return estimator, known_heat(estimator.network, run.period, run.whereabouts), options.get("measurement_sd")


def steps(
    estimator: Estimator,
    series: Series,
    seed: int,
    known: KnownHeat | None = None,
    *,
    single: bool = False,
    begun: Experience | None = None,
) -> Iterator[Step]:
    """Every sample of `series` through the loop of the zone worker, which looks no farther than a `single` step where
    nothing else is asked. `known` is needed where the network has terms; the estimator begins with what is `begun`."""
    loop = Loop(estimator, seed, (LEVEL,), known_heat=known, single_steps=single)
    carried, ahead = loop.begin()._replace(experience=begun), None
    for row, (when, outputs, inputs) in enumerate(zip(series.times, series.outputs, series.inputs, strict=True)):
        step = loop.step(carried, int(when), outputs, inputs, continues=not series.starts[row])
        standing = ahead if step.scored is not None else None
        yield Step(row, standing, step.posterior, step.disturbance, not step.started, step.carried)
        carried, ahead = step.carried, step.ahead


def run_filter(run: FilterRun) -> Arrays:
    """The arrays of a `Trace`. The `filtered` convention leaves out the noise `measurement_sd`, a number [K] or the
    posterior's median where it is learned; an estimator without that option (an ARX model, a bank) has no such rows."""
    estimator, known, measurement_sd = built(run)
    kept = _blank(len(run.series.times), len(estimator.network.parameters))
    began = time.perf_counter()
    for step in steps(estimator, run.series, run.seed, known, single=True):
        k, standing, posterior = step.row, step.standing, step.posterior
        if standing is not None:
            kept.mean[k] = standing.mean()[0]
            kept.lower[k], kept.upper[k] = standing.quantiles(TAILS, 0)
        noise = _left_out(measurement_sd, step)
        if step.assimilated and np.isfinite(noise):
            after = estimator.predictive(posterior.state)
            # Of the state behind the outputs.
            after = after._replace(sds=np.sqrt(np.maximum(after.sds**2 - noise**2, np.finfo(float).tiny)))
            kept.filtered_mean[k] = after.mean()[0]
            kept.filtered_lower[k], kept.filtered_upper[k] = after.quantiles(TAILS, 0)
        if len(posterior.alpha_quantiles):
            kept.alpha[k] = posterior.alpha_quantiles[np.argmax(posterior.alpha_quantiles[:, 1])]
        if posterior.gate is not None:
            kept.gate[k] = posterior.gate
        kept.theta[k] = posterior.parameters
        ended = time.perf_counter()
        kept.seconds[k], began = ended - began, ended
    return kept._asdict()


def _left_out(measurement_sd: object, step: Step) -> float:
    """sigma_y [K] of the first output; NaN where it is not known."""
    if isinstance(measurement_sd, int | float):
        return float(measurement_sd)
    if measurement_sd is None or step.disturbance is None:
        return float("nan")
    return float(step.disturbance().measurement_sd[0, 1])


def _blank(samples: int, parameters: int) -> Trace:
    columns = {name: np.full(samples, np.nan) for name in Trace._fields}
    columns["alpha"] = np.full((samples, 3), np.nan)
    columns["theta"] = np.full((samples, parameters), np.nan)
    return Trace(**columns)
