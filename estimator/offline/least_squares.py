"""Offline least squares on the open-loop error (paper 3.3.3): L-BFGS-B in the parameters' box, from several starts.

The optimiser works on each log parameter's place in its box, from 0 to 1, and, where initial temperatures are
estimated, on their distance from the network's starting rule in its standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, minimize
from scipy.stats import qmc

from estimator.arrays import Array
from estimator.errors import EstimatorError
from estimator.network.network import Network
from estimator.network.space import parameter_space
from estimator.network.starting import initial_temperatures
from estimator.offline.open_loop import OpenLoop, simulate_open_loop

__all__ = ["Fit", "Segment", "fit_open_loop", "simulate_open_loop"]

AT_BOUND = 1e-3
"""A parameter nearer to an end of its log box than this share of its width counts as being at the bound."""

_FARTHEST = 5.0
"""Standard deviations that an estimated initial temperature may lie from where the network's rule puts it."""

_OPTIMISER = {"maxiter": 2000, "maxfun": 4000, "maxcor": 20, "ftol": 1e-12, "gtol": 1e-9}


class Segment(NamedTuple):
    """A period without gaps: `inputs` (K, n_u) without NaN, `outputs` (K, n_y) in degC with NaN where missing.

    K is at least 2, and the first row of outputs has at least one value.
    """

    inputs: Array
    outputs: Array


class Fit(NamedTuple):
    """The best of all starts."""

    theta: Array
    """(n_theta,): parameters in the network's order, fixed ones included."""
    rmse: float
    """Root of (18) [K]: over all measured outputs but the first row of each segment."""
    initial_states: Array
    """(n_segments, n_x): where the simulation of each segment starts [degC]."""
    at_bound: tuple[str, ...]
    """Free parameters that ended at a bound of their box: it may be too narrow, or the data say nothing about them."""
    starts: Array
    """(n_starts,): RMSE [K] that each start came to; the first began at the middle of the box."""


def fit_open_loop(
    network: Network,
    period: float,
    segments: Sequence[Segment],
    *,
    starts: int = 8,
    seed: int = 0,
) -> Fit:
    """Fit the free parameters of `network` to `segments` sampled every `period` s.

    The first of `starts` begins at the middle of the box, the others at a Latin hypercube design drawn with `seed`.
    Initial temperatures of unmeasured nodes are estimated too, in the neighbourhood of the network's rule. Raises
    EstimatorError where a segment cannot be used.
    """
    problem = _Problem(network, period, segments)
    design = np.full((starts, problem.size), 0.5)
    if starts > 1 and problem.free:
        design[1:, : problem.free] = qmc.LatinHypercube(problem.free, rng=seed).random(starts - 1)
    design[:, problem.free :] = 0.0
    best, best_error, rmses = design[0], np.inf, []
    for first in design:
        result = _minimised(problem, first)
        rmses.append(float(np.sqrt(result.fun)))
        if result.fun < best_error:
            best, best_error = result.x, float(result.fun)
    return Fit(
        theta=problem.theta(best),
        rmse=float(np.sqrt(best_error)),
        initial_states=problem.initial_states(best),
        at_bound=problem.at_bound(best),
        starts=np.array(rmses),
    )


def _minimised(problem: _Problem, first: Array) -> OptimizeResult:
    """The minimum that is found from `first`; where there is nothing to fit, the error as it is."""
    if problem.size == 0:
        return OptimizeResult(x=first, fun=problem.evaluate(first)[0])
    return minimize(problem.evaluate, first, jac=True, method="L-BFGS-B", bounds=problem.bounds, options=_OPTIMISER)


class _Problem:
    """The mean squared open-loop error as a function of scaled variables: d places, then initial temperatures."""

    def __init__(self, network: Network, period: float, segments: Sequence[Segment]) -> None:
        if not segments:
            raise EstimatorError("there is no segment to fit; give at least one period without gaps")
        network = network.validate()
        self._network = network
        self._space = parameter_space(network, logit=False)
        self._loop = OpenLoop(network, period)
        self._segments = [_checked(segment, index, network) for index, segment in enumerate(segments)]
        rules = [initial_temperatures(network, s.outputs[0], s.inputs[0]) for s in self._segments]
        self._rule, self._sd = (np.array(part) for part in zip(*rules, strict=True))
        self._estimated = np.flatnonzero([node not in network.measured for node in network.nodes])
        self._count = sum(int(np.isfinite(segment.outputs[1:]).sum()) for segment in self._segments)
        if self._count == 0:
            raise EstimatorError(
                "the segments hold no measured output beyond their first rows; there is nothing to fit"
            )
        self.free = len(self._space.free)
        self.size = self.free + len(self._segments) * len(self._estimated)
        self.bounds = [(0.0, 1.0)] * self.free + [(-_FARTHEST, _FARTHEST)] * (self.size - self.free)

    def theta(self, variables: Array) -> Array:
        """(n_theta,)."""
        places = np.clip(variables[: self.free], 0.0, 1.0)
        return self._space.parameters(self._space.from_uniform(places[:, None]))[:, 0]

    def initial_states(self, variables: Array) -> Array:
        """(n_segments, n_x)."""
        states = self._rule.copy()
        moved = variables[self.free :].reshape(len(states), -1)
        states[:, self._estimated] += moved * self._sd[:, self._estimated]
        return states

    def at_bound(self, variables: Array) -> tuple[str, ...]:
        """Names of the free parameters that lie at an end of their box."""
        places = variables[: self.free]
        stuck = (places < AT_BOUND) | (places > 1 - AT_BOUND)
        return tuple(parameter.name for parameter, is_stuck in zip(self._network.free, stuck, strict=True) if is_stuck)

    def evaluate(self, variables: Array) -> tuple[float, Array]:
        """(18) and its gradient."""
        theta, gradient = self.theta(variables), np.zeros(self.size)
        by_initial = gradient[self.free :].reshape(len(self._segments), -1)
        width = self._space.upper - self._space.lower
        total = 0.0
        for index, (segment, initial) in enumerate(zip(self._segments, self.initial_states(variables), strict=True)):
            simulation = self._loop.simulate(theta, initial, segment.inputs)
            residual = np.nan_to_num(simulation.outputs - segment.outputs, nan=0.0)
            residual[0] = 0.0
            total += float((residual**2).sum())
            slope = self._loop.gradient(
                theta, self._space.free, segment.inputs, simulation.states, 2.0 / self._count * residual
            )
            gradient[: self.free] += slope.log_parameters * width
            by_initial[index] = slope.initial_state[self._estimated] * self._sd[index, self._estimated]
        return total / self._count, gradient


def _checked(segment: Segment, index: int, network: Network) -> Segment:
    """`segment` as float arrays, or EstimatorError."""
    at = f"segment {index} of network '{network.name}'"
    inputs, outputs = (np.asarray(part, dtype=np.float64) for part in segment)
    for name, part, width in (("inputs", inputs, len(network.inputs)), ("outputs", outputs, len(network.measured))):
        if part.ndim != 2 or part.shape[1] != width:
            raise EstimatorError(f"{at} has {name} of shape {part.shape}; they need {width} columns")
    if len(inputs) != len(outputs) or len(inputs) < 2:
        raise EstimatorError(
            f"{at} has {len(inputs)} rows of inputs and {len(outputs)} of outputs; it needs the same number, at least 2"
        )
    if not np.isfinite(inputs).all():
        raise EstimatorError(f"{at} has missing inputs; split it there")
    if np.isnan(outputs[0]).all():
        raise EstimatorError(f"{at} begins without a measured output; begin it where there is one")
    return Segment(inputs, outputs)
