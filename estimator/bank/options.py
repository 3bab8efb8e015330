"""Options of the bank: its members, and how their weights and the width of what is published are learned."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.errors import OptionsError
from estimator.network.family import family
from estimator.network.network import Network
from estimator.option_checks import check_known, in_force, names, number, whole

PRIOR_HOURS = (0.0, 1.0, 6.0, 24.0)
"""Leads [h] at which a member's weight a priori is given; the first is one step."""


class Member(NamedTuple):
    """One estimator of the bank: its kind, its network and its resolved options."""

    estimator: str
    network: Network
    options: Any
    prior: tuple[float, ...] = (1.0,) * len(PRIOR_HOURS)
    """What it weighs, relative to the others, before it has proved anything, at PRIOR_HOURS."""
    variant: str = "own"
    """Name of its network in the family of the bank's."""
    plans: bool = True
    """Whether it tells, if it has physics, what another heating would do; see `estimator.bank.bank`."""


def prior_at(prior: Sequence[float], hours: Array) -> Array:
    """`prior` at leads of `hours` (H,), of which the first is one step."""
    found = np.interp(np.sqrt(hours), np.sqrt(PRIOR_HOURS), prior)
    found[0] = prior[0]
    return found


Tables = dict[str, Mapping[str, object]]

DEFAULT_MEMBERS: Tables = {
    "jump": {"estimator": "mkf", "preset": "jump", "prior": (1.4, 1.0, 0.4, 0.2), "plans": False},
    "drift": {"estimator": "mkf", "preset": "drift", "prior": (3.0, 1.0, 0.2, 0.1)},
    "habits-slow": {"estimator": "mkf", "preset": "habits-slow", "prior": (0.3, 1.0, 1.0, 1.0), "plans": False},
    "habits": {"estimator": "mkf", "preset": "habits", "prior": (0.3, 0.3, 0.3, 0.3)},
    "ekf": {"estimator": "ekf", "prior": (0.6, 1.0, 1.0, 1.0)},
    "arx": {"estimator": "arx", "prior": (1.4, 1.0, 1.0, 1.0)},
    "direct": {"estimator": "direct", "prior": (0.5, 2.0, 6.0, 6.0)},
    "blind": {"estimator": "direct", "blind": True, "prior": (0.5, 2.0, 6.0, 6.0)},
}
"""Members that trust different things. The first one publishes its volatility and gate, see `BankOptions.voice`.

They are what was left when members were taken out for as long as no recording needed them. Who is best one step ahead
is much the same everywhere, so there the weights begin near those that were learned on recordings. Hours ahead, the
direct regressions begin with more than all others together: as persistence, for no physics is right on the first day.
"""


_BARE = "bare"
_KNOW_HEAT = ("habits-slow", "habits")
"""The members that know sun and habits, of a network that has terms for them."""


def default_members(network: Network) -> Tables:
    """The members of a bank that is told none: DEFAULT_MEMBERS, of which two know the terms of `network`."""
    if not network.terms:
        return DEFAULT_MEMBERS
    # Hundreds of particles would each learn what a few are enough for.
    return {
        name: table if name in _KNOW_HEAT else {**table, "network": _BARE} for name, table in DEFAULT_MEMBERS.items()
    }


def former_members(network: Network) -> tuple[Tables, ...]:
    """The members that a bank which is told none had before, the newest first: a zone with state of them goes on with
    them."""
    tables = default_members(network).items()
    former: Tables = {name: {**table, "plans": True} for name, table in tables if name != "habits"}
    return former, {name: table for name, table in former.items() if name != "blind"}


@dataclass(frozen=True)
class BankOptions:
    """Everything the bank can be told."""

    members: Mapping[str, Member] = field(default_factory=dict)
    voice: str = ""
    """The member whose volatility and gate are published."""
    discount: float = number(0.998, 0.5, 1.0)
    """What an hour leaves of an old cost."""
    learning_rate: float = number(0.1, 0.0, 10.0)
    """How much an hour's cost, in units of the mixture's, moves the log of a weight."""
    sharing: float = number(0.5, 0.0, 1.0)
    """How much of a horizon's cost counts at the next longer one."""
    coverage: float = number(0.95, 0.5, 0.999)
    """Level of the interval whose coverage is kept."""
    feedback: float = number(0.02, 0.0, 1.0)
    """Step of the log of the published spread at every verified forecast."""
    first_feedback: float = number(0.3, 0.0, 10.0)
    """The same times the number of verified forecasts, where that is more."""
    scenarios: int = whole(96, 8, 100_000)
    """Sampled futures that a member brings into a forecast."""


Resolve = Any
"""`resolve(estimator, network, period, given)` of the registry."""


def resolver(resolve_member: Resolve) -> Any:
    """`resolve(network, period, given)` of the bank, whose members `resolve_member` knows."""

    def resolve(network: Network, period: float, given: Mapping[str, object]) -> BankOptions:
        """The options in force; OptionsError with one sentence naming the option that is wrong."""
        check_known(given, names(BankOptions), "bank")
        tables = given.get("members", default_members(network))
        if not isinstance(tables, Mapping) or not tables:
            raise OptionsError(
                'members must be a table with one table per member, such as members.a.estimator = "mkf"', "members"
            )
        members = {
            str(name): _member(str(name), table, network, period, resolve_member) for name, table in tables.items()
        }
        numbers = {name: value for name, value in given.items() if name not in ("members", "voice")}
        return replace(in_force(BankOptions, network, numbers), members=members, voice=_voice(given, members))

    return resolve


def member_tables(
    members: Mapping[str, Member], written: Callable[[str, Any], Mapping[str, object]]
) -> dict[str, object]:
    """The tables that `members` resolve from, with every default; `written` gives the options of an estimator."""
    return {
        name: {
            "estimator": member.estimator,
            "network": member.variant,
            "prior": member.prior,
            "plans": member.plans,
            **written(member.estimator, member.options),
        }
        for name, member in members.items()
    }


def _member(name: str, table: object, network: Network, period: float, resolve_member: Resolve) -> Member:
    if not isinstance(table, Mapping) or not isinstance(table.get("estimator"), str):
        raise OptionsError(
            f'members.{name} must be a table that names its estimator, such as estimator = "mkf"', "members"
        )
    estimator = table["estimator"]
    if estimator == "bank":
        raise OptionsError(f"members.{name}: a bank cannot be a member of a bank", "members")
    variants = family(network)
    variant = table.get("network", next(iter(variants)))
    if not isinstance(variant, str) or variant not in variants:
        raise OptionsError(f"members.{name}.network = {variant!r} must be one of {', '.join(variants)}", "members")
    own = {key: value for key, value in table.items() if key not in ("estimator", "network", "prior", "plans")}
    prior, plans = _prior(name, table.get("prior", 1.0)), table.get("plans", True)
    if not isinstance(plans, bool):
        raise OptionsError(f"members.{name}.plans = {plans!r} must be true or false", "members")
    try:
        resolved = resolve_member(estimator, variants[variant], period, own)
    except OptionsError as error:
        raise OptionsError(f"members.{name}: {error}", "members") from error
    return Member(estimator, variants[variant], resolved, prior, str(variant), plans)


def _prior(name: str, given: object) -> tuple[float, ...]:
    values = list(given) if isinstance(given, list | tuple) else [given] * len(PRIOR_HOURS)
    numbers = [value for value in values if isinstance(value, int | float) and 0.0 < value <= 1e6]
    if len(numbers) != len(PRIOR_HOURS) or any(isinstance(value, bool) for value in values):
        raise OptionsError(
            f"members.{name}.prior must be a number above 0, or a list of {len(PRIOR_HOURS)}: its weight one step, "
            f"{', '.join(f'{hours:g}' for hours in PRIOR_HOURS[1:])} hours ahead",
            "members",
        )
    return tuple(float(value) for value in numbers)


def _voice(given: Mapping[str, object], members: Mapping[str, Member]) -> str:
    voice = given.get("voice") or next((name for name, member in members.items() if member.estimator == "rbpf"), "")
    voice = voice or next(iter(members))
    if not isinstance(voice, str) or voice not in members:
        raise OptionsError(f"voice = {voice!r} must be one of the members {', '.join(members)}", "voice")
    return str(voice)
