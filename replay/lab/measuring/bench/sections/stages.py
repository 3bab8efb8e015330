"""Where the time of one update goes: the calls that it is made of, each timed on its own.

The particle steps are timed where the filter calls them, whatever their number and names; the Kalman prediction is
split further by what it takes without the squarings of its exponential. What no call accounts for is Python and NumPy
between them.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np

from estimator import registry
from estimator.network.presets import building_67
from estimator.particle import rbpf
from estimator.types import Mixture
from replay.lab.measuring.bench.floor import floors
from replay.lab.measuring.bench.peak import peak
from replay.lab.measuring.bench.sizes import Sizes
from replay.lab.measuring.bench.workload import build, complete_update, pin_to_one_processor, samples, settled, timed
from replay.simulated.semi_synthetic import PERIOD

_NAMES = (
    "propagate_volatility",
    "effective_sample_size",
    "learning_gate",
    "liu_west_kernel",
)
"""Functions of `estimator.particle.rbpf`'s own module that are stages."""

_SHORT_PERIOD = 1e-3
"""A period in s so short that the exponential needs no squaring."""


class Clock:
    """Time spent in each stage, without that of the stages it calls."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.calls: dict[str, int] = defaultdict(int)
        self._inner = [0.0]

    def around(self, name: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """`work`, timed as `name`."""

        def measured(*arguments: Any, **named: Any) -> Any:
            self._inner.append(0.0)
            began = time.perf_counter()
            try:
                return work(*arguments, **named)
            finally:
                whole = time.perf_counter() - began
                self.seconds[name] += whole - self._inner.pop()
                self.calls[name] += 1
                self._inner[-1] += whole

        return measured


def stages(sizes: Sizes) -> Mapping[str, Any]:
    """Seconds per update of every stage on one processor, beside the floor by operations and bytes."""
    pin_to_one_processor()
    given, estimator = samples(), build(sizes.particles)
    state = settled(estimator, given, sizes.settle)
    plain, whole, clock = 0.0, 0.0, Clock()
    for index in range(sizes.settle, sizes.settle + sizes.repeats):
        now = given.at(index)
        plain += timed(lambda: complete_update(estimator, state, *now))[0]  # noqa: B023
        with _instrumented(estimator, clock):
            seconds, step = timed(lambda: complete_update(estimator, state, *now))  # noqa: B023
        whole += seconds
        state = step.state
    found = {
        name: {"s": seconds / sizes.repeats, "calls": clock.calls[name] / sizes.repeats}
        for name, seconds in clock.seconds.items()
    }
    found["between"] = {"s": (whole - sum(clock.seconds.values())) / sizes.repeats, "calls": 0.0}
    measured = peak()
    return {
        "particles": sizes.particles,
        "update_s": plain / sizes.repeats,
        "instrumented_update_s": whole / sizes.repeats,
        "stages": dict(sorted(found.items(), key=lambda item: -item[1]["s"])),
        "prediction": _prediction(sizes, state, given.inputs[0]),
        "peak": measured,
        "floor": floors(estimator, state, measured),
    }


@contextmanager
def _instrumented(estimator: Any, clock: Clock) -> Iterator[None]:
    """The calls of one update timed by `clock`."""
    steps = estimator._steps
    patches = [
        patch.object(steps, name, clock.around(name, getattr(steps, name)))
        for name in dir(steps)
        if not name.startswith("_") and callable(getattr(steps, name))
    ]
    patches += [
        patch.object(rbpf, name, clock.around(name, getattr(rbpf, name))) for name in _NAMES if hasattr(rbpf, name)
    ]
    draws = rbpf.Draws
    patches += [
        patch.object(draws, name, clock.around(f"draws: {name}", getattr(draws, name)))
        for name in dir(draws)
        if not name.startswith("_") and callable(getattr(draws, name))
    ]
    patches += [
        patch.object(Mixture, name, clock.around(f"mixture: {name}", getattr(Mixture, name))) for name in ("mean", "sd")
    ]
    for change in patches:
        change.start()
    try:
        yield
    finally:
        for change in reversed(patches):
            change.stop()


def _prediction(sizes: Sizes, state: Any, inputs: Any) -> dict[str, float]:
    """`predict` whole, and what the squarings in it take: what it takes less over a period that needs none."""
    seconds: dict[float, list[float]] = {PERIOD: [], _SHORT_PERIOD: []}
    filters = {
        period: registry.build("rbpf", building_67(), period, {"particles": sizes.particles}) for period in seconds
    }
    for _ in range(sizes.growth_repeats + 1):
        for period, estimator in filters.items():
            seconds[period].append(timed(lambda: estimator.predict(state, inputs))[0])  # noqa: B023
    whole, short = (float(np.median(taken[1:])) for taken in seconds.values())
    return {"predict_s": whole, "squarings_s": whole - short}
