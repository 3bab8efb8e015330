"""A finding: something about a zone's model that is not known or not plausible, and what to do about it."""

from __future__ import annotations

from typing import NamedTuple

AT_BOUND = "parameter-at-bound"
NOT_IDENTIFIED = "parameter-not-identified"
MEMBERS_DISAGREE = "members-disagree"
AGAINST_BALANCE = "heat-loss-against-balance"
IMPLAUSIBLE = "forecast-implausible"
MISSES_SOMETHING = "network-misses-something"
OTHER_VARIANT = "network-variant"
NARROWER_BOUNDS = "narrower-bounds"

FINDINGS = (
    IMPLAUSIBLE,
    AGAINST_BALANCE,
    AT_BOUND,
    NOT_IDENTIFIED,
    MEMBERS_DISAGREE,
    MISSES_SOMETHING,
    OTHER_VARIANT,
    NARROWER_BOUNDS,
)
"""Every name that a finding can have, in the order in which findings are listed. Names are stable."""


class Finding(NamedTuple):
    """`finding` is one of FINDINGS, `subject` a parameter, a derived quantity, a variant or "zone", and `sentence`
    one sentence with the problem and the remedy."""

    finding: str
    subject: str
    sentence: str


class VariantWeight(NamedTuple):
    """A variant of a zone's network, and the share of the forecast a few hours ahead that its members carry, 0 to 1."""

    variant: str
    weight: float


class Diagnosis(NamedTuple):
    """All findings about a zone at one time; `variants` is empty without members that differ in their network."""

    findings: tuple[Finding, ...] = ()
    variants: tuple[VariantWeight, ...] = ()


def amount(value: float) -> str:
    """`value` with three significant digits, as people write it and TOML reads it."""
    rounded = float(f"{value:.3g}")
    if 1e-3 <= abs(rounded) < 1e6 or rounded == 0.0:
        return f"{rounded:.10g}"
    return f"{value:.3g}".replace("e+0", "e").replace("e+", "e")
