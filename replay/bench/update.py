"""One complete update: compiled against the project's own NumPy oracle in the same run, and on two threads."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from estimator import registry
from estimator.options import Options
from estimator.presets import building_67
from estimator.rbpf import RBPF
from replay.bench.sizes import Sizes
from replay.bench.workload import (
    Samples,
    Step,
    build,
    complete_update,
    pin_to_one_processor,
    samples,
    settled,
    spread,
    timed,
)
from replay.semi_synthetic import PERIOD


def one_thread(sizes: Sizes) -> Mapping[str, Any]:
    """Both implementations step from the same states, in turn, on one processor."""
    pin_to_one_processor()
    given = samples()
    compiled, oracle = build(sizes.particles), build(sizes.particles, {"implementation": "reference"})
    state = settled(compiled, given, sizes.settle)
    complete_update(oracle, state, *given.at(sizes.settle))
    quick: list[float] = []
    slow: list[float] = []
    apart, resampled = 0.0, 0
    every = max(1, sizes.repeats // sizes.oracle_repeats)
    for index in range(sizes.settle, sizes.settle + sizes.repeats):
        now = given.at(index)
        seconds, step = timed(lambda: complete_update(compiled, state, *now))  # noqa: B023
        quick.append(seconds)
        resampled += step.resampled
        if (index - sizes.settle) % every == 0:
            seconds, expected = timed(lambda: complete_update(oracle, state, *now))  # noqa: B023
            slow.append(seconds)
            apart = max(apart, float(np.abs(step.quantiles - expected.quantiles).max()))
        state = step.state
    return {
        "particles": sizes.particles,
        "compiled": spread(quick),
        "oracle": spread(slow),
        "ratio": float(np.median(slow) / np.median(quick)),
        "resampled_share": resampled / len(quick),
        "largest_difference_K": apart,
    }


def two_threads(sizes: Sizes) -> Mapping[str, Any]:
    """One and two threads in turn from the same states; the published numbers must be the same bits."""
    one, two = _on_threads(sizes.particles, 1), _on_threads(sizes.particles, 2)
    if one is None or two is None:
        return {"skipped": "the estimator has no option for the number of threads of one update"}
    given = samples()
    state = settled(one, given, sizes.settle)
    complete_update(two, state, *given.at(sizes.settle))
    seconds: dict[int, list[float]] = {1: [], 2: []}
    same = True
    for index in range(sizes.settle, sizes.settle + sizes.repeats):
        alone, step = _step(one, state, given, index)
        together, other = _step(two, state, given, index)
        seconds[1].append(alone)
        seconds[2].append(together)
        same = same and bool((step.quantiles == other.quantiles).all())
        state = step.state
    return {
        "particles": sizes.particles,
        "one_thread": spread(seconds[1]),
        "two_threads": spread(seconds[2]),
        "ratio": float(np.median(seconds[1]) / np.median(seconds[2])),
        "same_bits": same,
    }


def _step(estimator: RBPF, state: Any, given: Samples, index: int) -> tuple[float, Step]:
    return timed(lambda: complete_update(estimator, state, *given.at(index)))


def _on_threads(particles: int, threads: int) -> RBPF | None:
    """The filter on so many threads: an option, or an argument of the builder, whichever the estimator offers."""
    if "threads" in {field.name for field in fields(Options)}:
        return build(particles, {"threads": threads})
    offered = inspect.signature(registry.build).parameters
    if "threads" in offered:
        given: dict[str, Any] = {"threads": threads}
        return registry.build("rbpf", building_67(), PERIOD, {"particles": particles}, **given)
    return None
