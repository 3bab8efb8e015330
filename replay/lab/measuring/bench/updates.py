"""Complete updates of the particle filter on building 67: how long, on two threads, and how the time grows."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from estimator import registry
from estimator.arrays import Array
from estimator.network.presets import building_67
from estimator.particle.options import resolve
from estimator.particle.rbpf import RBPF
from estimator.types import Estimator
from replay.lab.measuring.bench.section import Details, Section, Sizes, Target, exponent, median, spread, text, timed
from replay.simulated import semi_synthetic
from replay.simulated.semi_synthetic import PERIOD

TAILS = np.array([0.5, 0.025, 0.975])
"""Levels of the published median and of the interval at .95."""
_DAYS = 20
_ROUNDS = 6
"""How often one thread and two are timed, in turn."""
_LINEAR = 1.1
"""The exponent of a growth that counts as linear."""


class Samples(NamedTuple):
    """A simulated period with heating, sun and an unmeasured gain: outputs (K, 1) and inputs (K, 3)."""

    outputs: Array
    inputs: Array

    def at(self, index: int) -> tuple[Array, Array]:
        """Outputs and inputs of sample `index`, from the beginning again after the last."""
        row = index % len(self.outputs)
        return self.outputs[row], self.inputs[row]


def samples() -> Samples:
    """Samples of building 67, on which resampling happens as often as it does in use."""
    columns, network = semi_synthetic.generate(None, days=_DAYS, seed=1).columns, building_67()
    return Samples(
        *(np.column_stack([columns[name] for name in names]) for names in (network.measured, network.inputs))
    )


def build(particles: int, options: Mapping[str, object] | None = None) -> RBPF:
    """The filter of building 67, all ten parameters free, with the default options and what `options` changes."""
    network = building_67()
    return RBPF(network, PERIOD, resolve(network, PERIOD, {"particles": particles, **(options or {})}))


def complete_update(estimator: Estimator, state: Any, outputs: Array, inputs: Array) -> tuple[Any, Array]:
    """The next state and the published quantiles (3,): all that a zone's worker has its estimator do with one sample.

    Weights, measurement update, gate, resampling when due and rejuvenation; volatility, zero-order hold and Kalman
    prediction to the next sample; mean, spread, median and interval of its forecast.
    """
    state = estimator.predict(estimator.update(state, outputs).state, inputs)
    mixture = estimator.predictive(state)
    mixture.mean(), mixture.sd()
    return state, estimator.quantiles(mixture, TAILS, 0)


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


def update(sizes: Sizes) -> Section:
    """The compiled update and the project's own NumPy oracle from the same states, in turn, on one processor."""
    _on_one_processor()
    given = samples()
    compiled, oracle = build(sizes.particles), build(sizes.particles, {"implementation": "reference"})
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
    ratio = median(slow) / median(quick)
    return Section(
        (
            Target("one complete update, one thread", "at most 1.5 ms", spread(quick), median(quick) <= 1.5e-3),
            Target(
                "the project's own NumPy oracle, same run",
                "at least 20 times slower, the same within 1e-6 K",
                f"{text(median(slow))}, {ratio:.1f} times, {apart:.0e} K apart",
                ratio >= 20.0 and apart < 1e-6,
            ),
        ),
        (_of_each_kind(sizes, given),),
    )


def _of_each_kind(sizes: Sizes, given: Samples) -> Details:
    """Table 9 of the paper: time and memory of a sample."""
    rows = []
    for name in ("rbpf", "ekf", "ukf"):
        options = {"particles": sizes.particles} if name == "rbpf" else {}
        estimator = registry.build(name, building_67(), PERIOD, options)
        state, seconds = settled(estimator, given, sizes.settle), []
        for index in range(sizes.settle, sizes.settle + sizes.growth_repeats):
            one, (state, _) = timed(lambda: complete_update(estimator, state, *given.at(index)))  # noqa: B023
            seconds.append(one)
        size = sum(np.asarray(part).nbytes for part in state) / 1e6
        rows.append((name, spread(seconds), f"{size:.3g}"))
    text = "The paper has 55 ms and 2.9 MB for 9,000 particles on an Intel Xeon of 2.20 GHz (Table 9)."
    return Details("Time and memory of a sample", text, ("estimator", "a complete update", "state, MB"), rows)


def threads(sizes: Sizes) -> Section:
    """Two zones stepped one after the other, and at once on two threads, as the daemon steps its zones.

    The samples of a zone depend on each other, and there are more zones than processors: the daemon never divides one
    update. The published numbers must be the same bits.
    """
    given, zones = samples(), [build(sizes.particles) for _ in range(2)]
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
    ratio = median(alone) / median(together)
    return Section(
        (
            Target(
                "updates of two zones on two threads, against one thread",
                "at least 1.7 times one thread, same bits",
                f"{text(median(together))}, {ratio:.2f} times, {'same' if same else 'OTHER'} bits",
                ratio >= 1.7 and same,
            ),
        )
    )


def growth(sizes: Sizes) -> Section:
    """The time of an update over particles, and that of a sweep over zones, on one processor."""
    _on_one_processor()
    given, by_particles, by_zones = samples(), [], []
    for count in sizes.particle_counts:
        estimator = build(count)
        by_particles.append((count, _sweep(estimator, settled(estimator, given, sizes.settle), given, 1, sizes)))
    estimator = build(sizes.particles)
    start = settled(estimator, given, sizes.settle)
    by_zones = [(count, _sweep(estimator, start, given, count, sizes)) for count in sizes.zone_counts]
    targets, details = [], []
    for name, work, rows in (("particles", "an update", by_particles), ("zones", "a sweep", by_zones)):
        p = exponent(rows)
        found = f"p = {p:.2f} from {rows[0][0]:,} to {rows[-1][0]:,}"
        targets.append(Target(f"growth in {name}: time of {work} ~ {name}^p", "linear", found, p <= _LINEAR))
        table = [(f"{count:,}", f"{1e3 * each:.2f}", f"{1e6 * each / count:.3g}") for count, each in rows]
        details.append(Details(f"Growth in {name}", "", (name, f"ms for {work}", f"us for each of the {name}"), table))
    return Section(targets, details)


def _sweep(estimator: Any, start: Any, given: Samples, zones: int, sizes: Sizes) -> float:
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
    return median(seconds[1:])
