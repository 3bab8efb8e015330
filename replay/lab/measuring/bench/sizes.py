"""How much of everything a run measures."""

from __future__ import annotations

from typing import NamedTuple


class Sizes(NamedTuple):
    """Counts of a run; `particles` is N of every row that does not vary it."""

    particles: int
    settle: int
    """Samples before anything is measured: the filter has found its way by then."""
    repeats: int
    """Updates that are timed, one by one."""
    oracle_repeats: int
    """Updates that the NumPy oracle is timed on."""
    particle_counts: tuple[int, ...]
    zone_counts: tuple[int, ...]
    growth_repeats: int
    replay_days: int
    resident_zones: tuple[int, ...]
    filterpy_particles: int
    fleet_zones: int
    fleet_particles: int
    fleet_every: float
    fleet_rounds: int
    control_zones: int


FULL = Sizes(
    particles=9000,
    settle=300,
    repeats=600,
    oracle_repeats=60,
    particle_counts=(1000, 3000, 10_000, 30_000, 100_000),
    zone_counts=(1, 10, 100, 1000),
    growth_repeats=30,
    replay_days=154,
    resident_zones=(1, 50, 100, 200, 400, 700, 1000),
    filterpy_particles=300,
    fleet_zones=1000,
    fleet_particles=9000,
    fleet_every=10.0,
    fleet_rounds=6,
    control_zones=50,
)

TINY = Sizes(
    particles=200,
    settle=5,
    repeats=5,
    oracle_repeats=3,
    particle_counts=(100, 200, 400),
    zone_counts=(1, 2, 4),
    growth_repeats=3,
    replay_days=1,
    resident_zones=(1, 2, 4),
    filterpy_particles=3,
    fleet_zones=3,
    fleet_particles=60,
    fleet_every=1.0,
    fleet_rounds=2,
    control_zones=2,
)
"""For the test that the measurements run; their figures mean nothing."""

SIZES = {"full": FULL, "tiny": TINY}
