"""The online estimators by name. A new one is one file, and one entry in `ESTIMATORS`."""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any, NamedTuple

from estimator.bank.bank import Bank
from estimator.bank.options import BankOptions, member_tables, resolver
from estimator.blackbox import options as arx_options
from estimator.blackbox.arx import ARX
from estimator.blackbox.daily import Daily
from estimator.blackbox.direct import Direct
from estimator.errors import OptionsError
from estimator.gaussian import options as gaussian_options
from estimator.gaussian.ekf import EKF
from estimator.gaussian.ukf import UKF
from estimator.mixture import options as mkf_options
from estimator.mixture.mkf import MKF
from estimator.network.network import Network
from estimator.particle import options as rbpf_options
from estimator.particle.rbpf import RBPF
from estimator.types import Estimator


class EstimatorKind(NamedTuple):
    """How an estimator is told what to do, and how it is built."""

    resolve: Callable[[Network, float, Mapping[str, object]], Any]
    """The options in force, as a frozen dataclass, for a network at a period in s; OptionsError if they are wrong."""
    build: Callable[[Network, float, Any], Estimator]
    """The estimator of a network at a period in s, from resolved options."""
    structural: tuple[str, ...] = ()
    """Options that decide what the arrays of a stored state mean; the others may change between two starts."""
    terms: bool = False
    """Whether it has a place for the terms of a network; one that has none is built for the network without them."""


def _build_bank(network: Network, period: float, options: BankOptions) -> Estimator:
    members = {
        name: construct(member.estimator, member.network, period, member.options)
        for name, member in options.members.items()
    }
    return Bank(network, period, options, members)


ESTIMATORS: dict[str, EstimatorKind] = {
    "rbpf": EstimatorKind(
        rbpf_options.resolve,
        RBPF,
        ("particles", "coordinates", "volatility_blocks", "alpha_min", "alpha_max", "histogram_bins"),
    ),
    "ekf": EstimatorKind(gaussian_options.resolve_ekf, EKF),
    "ukf": EstimatorKind(gaussian_options.resolve_ukf, UKF),
    "mkf": EstimatorKind(
        mkf_options.resolve,
        MKF,
        ("particles", "volatility_blocks", "alpha_min", "alpha_max", "histogram_bins", "volatility", "gain"),
        terms=True,
    ),
    "bank": EstimatorKind(resolver(lambda *of: resolve(*of)), _build_bank, terms=True),
    "arx": EstimatorKind(arx_options.resolve, ARX, ("past_outputs", "past_inputs")),
    "daily": EstimatorKind(arx_options.resolve_daily, Daily, ("past_outputs", "past_inputs")),
    "direct": EstimatorKind(arx_options.resolve_direct, Direct, ("blind",)),
}


def resolve(estimator: str, network: Network, period: float, given: Mapping[str, object]) -> Any:
    """The options in force, defaults filled, as the frozen dataclass of the estimator; OptionsError names the estimator
    or the options that do not exist or fit."""
    return _kind(estimator).resolve(network, period, given)


def construct(estimator: str, network: Network, period: float, options: Any) -> Estimator:
    """The estimator called `estimator` for `network` at `period` s, with options that `resolve` returned."""
    kind = _kind(estimator)
    return kind.build(network if kind.terms else network.without_terms(), period, options)


def build(estimator: str, network: Network, period: float, given: Mapping[str, object]) -> Estimator:
    """The estimator called `estimator` for `network` at `period` s with the options `given`; OptionsError if wrong."""
    return construct(estimator, network, period, resolve(estimator, network, period, given))


def as_mapping(options: Any) -> dict[str, object]:
    """Resolved options by name, without those that are not set."""
    return {name: value for name, value in asdict(options).items() if value is not None}


def written(estimator: str, options: Any) -> dict[str, object]:
    """Resolved options as `resolve` accepts them, every default included."""
    named = as_mapping(options)
    return named | {"members": member_tables(options.members, written)} if estimator == "bank" else named


def structure(estimator: str, options: Any) -> dict[str, object]:
    """The structural ones among resolved options, by name; of a bank those of its members, in their order."""
    if estimator == "bank":
        members = [
            (name, each.variant, each.estimator, structure(each.estimator, each.options))
            for name, each in options.members.items()
        ]
        return {"members": members}
    named, structural = as_mapping(options), _kind(estimator).structural
    # What is off is left out, so that an option that is new leaves older state as it is.
    return {name: named[name] for name in structural if name in named and named[name] is not False}


def _kind(estimator: str) -> EstimatorKind:
    if estimator not in ESTIMATORS:
        raise OptionsError(f"unknown estimator '{estimator}'; the estimators are {', '.join(ESTIMATORS)}")
    return ESTIMATORS[estimator]
