"""A finding: something about a zone's model that is not known or not plausible, and what to do about it."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

AT_BOUND = "parameter-at-bound"
NOT_IDENTIFIED = "parameter-not-identified"
MEMBERS_DISAGREE = "members-disagree"
AGAINST_BALANCE = "heat-loss-against-balance"
IMPLAUSIBLE = "forecast-implausible"
MISSES_SOMETHING = "network-misses-something"
TAKEN_FOR_CLEAR = "sky-taken-for-clear"
OTHER_VARIANT = "network-variant"
NARROWER_BOUNDS = "narrower-bounds"
CALLS_WITHOUT_HEAT = "calls-without-heat"
HEAT_WITHOUT_CALL = "heat-without-call"

SENSOR_STUCK = "sensor-stuck"
SENSOR_SPIKES = "sensor-spikes"
SENSOR_JUMPED = "sensor-jumped"
SENSOR_DRIFTS = "sensor-drifts"
UNIT_CHANGED = "unit-changed"
SIGN_FLIPPED = "sign-flipped"
METER_DEAD = "meter-dead"
METER_LATE = "meter-late"
CHANNELS_SWAPPED = "channels-swapped"

TELEMETRY = (
    CHANNELS_SWAPPED,
    SENSOR_STUCK,
    SENSOR_SPIKES,
    UNIT_CHANGED,
    SIGN_FLIPPED,
    METER_DEAD,
    METER_LATE,
    SENSOR_JUMPED,
    SENSOR_DRIFTS,
)
"""Findings about what is measured. While there is one, forecasts rest on telemetry that is not to be believed."""

FINDINGS = (
    *TELEMETRY,
    CALLS_WITHOUT_HEAT,
    HEAT_WITHOUT_CALL,
    IMPLAUSIBLE,
    AGAINST_BALANCE,
    AT_BOUND,
    NOT_IDENTIFIED,
    MEMBERS_DISAGREE,
    MISSES_SOMETHING,
    TAKEN_FOR_CLEAR,
    OTHER_VARIANT,
    NARROWER_BOUNDS,
)
"""Every name that a finding can have, in the order in which findings are listed. Names are stable."""

FOR_EXPERTS = (AT_BOUND, NOT_IDENTIFIED, MEMBERS_DISAGREE, OTHER_VARIANT, NARROWER_BOUNDS)
"""Findings for those who read parameters: nobody else has anything to do about them."""


def _told(text: str, example: str | None = None) -> Any:
    """A field of which `text` says what it means wherever a finding is published."""
    return field(metadata={"description": text} | ({} if example is None else {"examples": [example]}))


@dataclass(frozen=True, slots=True)
class Finding:
    """Something about the zone's model that is not known or not plausible."""

    finding: str = _told("stable name of the kind of finding", AT_BOUND)
    subject: str = _told("a parameter, a channel, heat_loss, a variant of the network, or zone", "C_i")
    sentence: str = _told("the problem and its remedy in one sentence")


@dataclass(frozen=True, slots=True)
class VariantWeight:
    """A variant of the zone's network among the members of a bank."""

    variant: str = _told("own: the zone's network as it is")
    weight: float = _told("share of the forecast 6 h ahead that its members carry, 0 to 1")


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
