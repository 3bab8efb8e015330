"""Who makes forecasts: every estimator with the options that a user gets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from replay.experiments.request import Request
from replay.experiments.series.networks import zone_of

LEAST_SQUARES = "least squares"
REGRESSIONS = ARX, DAILY = "ARX", "daily"
"""Those that know no physics."""
RBPF, MKF, BANK = "RBPF default", "MKF", "bank"


class Rival(NamedTuple):
    """An online estimator and its options; one that draws random numbers runs once for each seed."""

    label: str
    estimator: str
    options: Mapping[str, object]
    seeded: bool


_RIVALS = (
    Rival(ARX, "arx", {}, False),
    Rival(DAILY, "daily", {}, False),
    Rival("EKF", "ekf", {}, False),
    Rival("UKF", "ukf", {}, False),
    Rival("RBPF paper", "rbpf", {"preset": "paper"}, True),
    Rival(RBPF, "rbpf", {}, True),
    Rival(MKF, "mkf", {}, True),
    Rival(BANK, "bank", {}, True),
)


def rivals(request: Request) -> list[Rival]:
    """Every online estimator, that of the zone of --config among them, with --particles if given.

    A zone that leaves its estimator at the defaults adds none: it would be a rival of itself.
    """
    found = list(_RIVALS)
    if request.config is not None:
        zone = zone_of(request)
        if (zone.estimator, zone.estimator_options) not in [(rival.estimator, rival.options) for rival in found]:
            found.append(Rival(f"as configured ({zone.estimator})", zone.estimator, zone.estimator_options, True))
    if request.particles is None:
        return found
    return [
        rival._replace(options={**rival.options, "particles": request.particles})
        if rival.estimator == "rbpf"
        else rival
        for rival in found
    ]
