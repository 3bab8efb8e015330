"""Complete updates of the particle filter on building 67: how long, on two threads, and how the time grows."""

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from bench.rows import Row, Sizes, growth, spread, text, timed

from estimator import registry
from estimator.arrays import Array
from estimator.network.presets import PRESETS
from estimator.types import Estimator
from replay.simulated import semi_synthetic
from replay.simulated.semi_synthetic import PERIOD

TAILS = np.array([0.5, 0.025, 0.975])
"""Levels of the published median and of the interval at .95."""
_ROUNDS = 6
"""How often one thread and two are timed, in turn."""


class Samples:
    """Twenty simulated days of building 67 with an unmeasured gain, on which resampling happens as often as in use."""

    def __init__(self) -> None:
        columns, network = semi_synthetic.generate(None, days=20, seed=1).columns, PRESETS["building-67"]
        self._outputs, self._inputs = (
            np.column_stack([columns[name] for name in names]) for names in (network.measured, network.inputs)
        )

    def at(self, index: int) -> tuple[Array, Array]:
        """Outputs and inputs of sample `index`, from the beginning again after the last."""
        row = index % len(self._outputs)
        return self._outputs[row], self._inputs[row]


def build(particles: int, **options: object) -> Estimator:
    """The filter of building 67, all ten parameters free, with the default options and what `options` changes."""
    return registry.build("rbpf", PRESETS["building-67"], PERIOD, {"particles": particles, **options})


def complete_update(estimator: Estimator, state: Any, outputs: Array, inputs: Array) -> tuple[Any, Array]:
    """The next state and the published quantiles (3,): all that a zone's worker has its estimator do with one sample.

    Weights, measurement update, gate, resampling when due and rejuvenation; volatility, zero-order hold and Kalman
    prediction to the next sample; mean, spread, median and interval of its forecast.
    """
    state = estimator.predict(estimator.update(state, outputs).state, inputs)
    mixture = estimator.predictive(state)
    mixture.mean(), mixture.sd()
    return state, mixture.quantiles(TAILS, 0)


def settled(estimator: Estimator, given: Samples, steps: int, seed: int = 1) -> Any:
    """The filter's state after `steps` samples."""
    outputs, inputs = given.at(0)
    state = estimator.predict(estimator.start(seed, outputs, inputs), inputs)
    for index in range(1, steps):
        state, _ = complete_update(estimator, state, *given.at(index))
    return state


def _on_one_processor() -> None:
    """Keep this process, libraries' threads included, on a single processor: the first that it may use."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def update(sizes: Sizes) -> list[Row]:
    """The compiled update and the project's own NumPy oracle from the same states, in turn, on one processor; and the
    time of a sample of each kind of estimator (paper, Table 9: 55 ms for 9,000 particles)."""
    _on_one_processor()
    given = Samples()
    compiled, oracle = build(sizes.particles), build(sizes.particles, implementation="reference")
    state = settled(compiled, given, sizes.settle)
    complete_update(oracle, state, *given.at(sizes.settle))
    quick: list[float] = []
    slow: list[float] = []
    apart = 0.0
    for index in range(sizes.settle, sizes.settle + sizes.repeats):
        now = given.at(index)
        seconds, (after, quantiles) = timed(lambda: complete_update(compiled, state, *now))  # noqa: B023
        quick.append(seconds)
        if index % 10 == 0:
            seconds, (_, expected) = timed(lambda: complete_update(oracle, state, *now))  # noqa: B023
            slow.append(seconds)
            apart = max(apart, float(np.abs(quantiles - expected).max()))
        state = after
    ratio = float(np.median(slow) / np.median(quick))
    rows = [
        Row("one complete update, one thread", "at most 1.5 ms", spread(quick), bool(np.median(quick) <= 1.5e-3)),
        Row(
            "the project's own NumPy oracle, same run",
            "at least 20 times slower, the same within 1e-6 K",
            f"{text(float(np.median(slow)))}, {ratio:.1f} times, {apart:.0e} K apart",
            ratio >= 20.0 and apart < 1e-6,
        ),
    ]
    for name in ("ekf", "ukf"):
        estimator = registry.build(name, PRESETS["building-67"], PERIOD, {})
        state, taken = settled(estimator, given, sizes.settle), []
        for index in range(sizes.settle, sizes.settle + sizes.growth_repeats):
            seconds, (state, _) = timed(lambda: complete_update(estimator, state, *given.at(index)))  # noqa: B023
            taken.append(seconds)
        rows.append(Row(f"one complete update of `{name}`", "", spread(taken), None))
    return rows


def threads(sizes: Sizes) -> list[Row]:
    """Two zones stepped one after the other, and at once on two threads, as the daemon steps its zones.

    The samples of a zone depend on each other, and there are more zones than processors: the daemon never divides one
    update. The published numbers must be the same bits.
    """
    given, zones = Samples(), [build(sizes.particles) for _ in range(2)]
    starts = [settled(zone, given, sizes.settle, seed) for seed, zone in enumerate(zones, 1)]
    count = max(2, sizes.repeats // _ROUNDS)

    def run(zone: int) -> bytes:
        state, published = starts[zone], b""
        for index in range(sizes.settle, sizes.settle + count):
            state, quantiles = complete_update(zones[zone], state, *given.at(index))
            published += quantiles.tobytes()
        return published

    alone, together, same = [], [], True
    with ThreadPoolExecutor(2) as pool:
        for _ in range(_ROUNDS):
            seconds, bits = timed(lambda: [run(0), run(1)])
            alone.append(seconds / (2 * count))
            seconds, other = timed(lambda: list(pool.map(run, (0, 1))))
            together.append(seconds / (2 * count))
            same = same and bits == other
    ratio = float(np.median(alone) / np.median(together))
    found = f"{text(float(np.median(together)))}, {ratio:.2f} times, {'same' if same else 'OTHER'} bits"
    work = "updates of two zones on two threads, against one thread"
    return [Row(work, "at least 1.7 times one thread, same bits", found, ratio >= 1.7 and same)]


def grown(sizes: Sizes) -> list[Row]:
    """The time of an update over particles, and that of a sweep over zones, on one processor."""
    _on_one_processor()
    given, by_particles = Samples(), []
    for count in sizes.particle_counts:
        estimator = build(count)
        by_particles.append((count, _sweep(estimator, settled(estimator, given, sizes.settle), given, 1, sizes)))
    estimator = build(sizes.particles)
    start = settled(estimator, given, sizes.settle)
    by_zones = [(count, _sweep(estimator, start, given, count, sizes)) for count in sizes.zone_counts]
    return [
        growth("growth in particles: time", "N", by_particles),
        growth("growth in zones: time of a sweep", "zones", by_zones),
    ]


def _sweep(estimator: Estimator, start: Any, given: Samples, zones: int, sizes: Sizes) -> float:
    """Median seconds of a sweep over so many zones, every one with arrays of its own."""
    states = [type(start)(*(part.copy() for part in start)) for _ in range(zones)]
    seconds = []
    # A few sweeps over many zones last as long as many sweeps over one.
    for index in range(sizes.settle, sizes.settle + max(3, sizes.growth_repeats // zones)):

        def sweep(index: int = index) -> None:
            for zone, state in enumerate(states):
                states[zone], _ = complete_update(estimator, state, *given.at(index))

        seconds.append(timed(sweep)[0])
    # In the first sweep the processor's caches and the allocator are not yet where they stay.
    return float(np.median(seconds[1:]))
