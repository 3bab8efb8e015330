"""One complete update: compiled against the project's own NumPy oracle in the same run, and on two threads."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from replay.lab.measuring.bench.sizes import Sizes
from replay.lab.measuring.bench.workload import (
    build,
    complete_update,
    pin_to_one_processor,
    samples,
    settled,
    spread,
    timed,
)

_ROUNDS = 6
"""How often both ways are timed, in turn."""


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
    """Two zones stepped one after the other, and at once on two threads, as the daemon steps its zones.

    The samples of a zone depend on each other, and there are more zones than processors: the daemon never divides one
    update. The published numbers must be the same bits.
    """
    given = samples()
    zones = [build(sizes.particles) for _ in range(2)]
    starts = [settled(zone, given, sizes.settle, seed) for seed, zone in enumerate(zones, 1)]
    count = max(2, sizes.repeats // _ROUNDS)
    seconds: dict[int, list[float]] = {1: [], 2: []}
    published: dict[int, list[bytes]] = {1: [], 2: []}

    def run(zone: int) -> bytes:
        state, quantiles = starts[zone], b""
        for index in range(sizes.settle, sizes.settle + count):
            step = complete_update(zones[zone], state, *given.at(index))
            state, quantiles = step.state, quantiles + step.quantiles.tobytes()
        return quantiles

    with ThreadPoolExecutor(2) as pool:
        for _ in range(_ROUNDS):
            alone, bits = timed(lambda: [run(0), run(1)])
            together, other = timed(lambda: list(pool.map(run, (0, 1))))
            seconds[1].append(alone / (2 * count))
            seconds[2].append(together / (2 * count))
            published[1] += bits
            published[2] += other
    return {
        "particles": sizes.particles,
        "one_thread": spread(seconds[1]),
        "two_threads": spread(seconds[2]),
        "ratio": float(np.median(seconds[1]) / np.median(seconds[2])),
        "same_bits": published[1] == published[2],
    }
