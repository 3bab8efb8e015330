"""How the time of an update grows with the number of particles, and that of a sweep with the number of zones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from replay.lab.measuring.bench.sizes import Sizes
from replay.lab.measuring.bench.workload import (
    build,
    complete_update,
    pin_to_one_processor,
    samples,
    settled,
    slope,
    spread,
    timed,
)


def growth(sizes: Sizes) -> Mapping[str, Any]:
    """On one processor: medians, and the exponents of their growth (1 is linear)."""
    pin_to_one_processor()
    given = samples()
    by_particles: list[dict[str, Any]] = []
    for count in sizes.particle_counts:
        estimator = build(count)
        state = settled(estimator, given, sizes.settle)
        seconds = []
        for index in range(sizes.settle, sizes.settle + sizes.growth_repeats):
            taken, step = timed(lambda: complete_update(estimator, state, *given.at(index)))  # noqa: B023
            seconds.append(taken)
            state = step.state
        by_particles.append({"particles": count} | spread(seconds))
    estimator = build(sizes.particles)
    start = settled(estimator, given, sizes.settle)
    by_zones = [
        {"zones": count} | spread(_sweeps(estimator, start, given, count, sizes)) for count in sizes.zone_counts
    ]
    return {
        "particles": by_particles,
        "particles_exponent": slope(
            [row["particles"] for row in by_particles], [row["median_s"] for row in by_particles]
        ),
        "zones": by_zones,
        "zones_exponent": slope([row["zones"] for row in by_zones], [row["median_s"] for row in by_zones]),
        "particles_of_a_zone": sizes.particles,
    }


def _sweeps(estimator: Any, start: Any, given: Any, zones: int, sizes: Sizes) -> list[float]:
    """Seconds of each sweep over so many zones, every one with arrays of its own."""
    states = [type(start)(*(part.copy() for part in start)) for _ in range(zones)]
    seconds = []
    # A few sweeps over many zones last as long as many sweeps over one.
    for index in range(sizes.settle, sizes.settle + max(3, sizes.growth_repeats // zones)):
        now = given.at(index)

        def sweep(now: Any = now) -> None:
            for zone, state in enumerate(states):
                states[zone] = complete_update(estimator, state, *now).state

        taken, _ = timed(sweep)
        seconds.append(taken)
    # In the first sweep the processor's caches and the allocator are not yet where they stay.
    return seconds[1:]
