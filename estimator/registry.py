"""The online estimators by name. A new one is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from estimator import augmented_options, mkf_options
from estimator import options as rbpf_options
from estimator.ekf import ekf
from estimator.errors import OptionsError
from estimator.mkf import MKF
from estimator.network import Network
from estimator.rbpf import RBPF
from estimator.types import Estimator
from estimator.ukf import ukf


class _Entry(NamedTuple):
    resolve: Callable[[Network, float, Mapping[str, object]], Mapping[str, object]]
    build: Callable[[Network, float, Mapping[str, object]], Estimator]


def _resolve_rbpf(network: Network, period: float, given: Mapping[str, object]) -> Mapping[str, object]:
    return rbpf_options.as_mapping(rbpf_options.resolve(network, period, given))


def _build_rbpf(network: Network, period: float, given: Mapping[str, object]) -> Estimator:
    return RBPF(network, period, rbpf_options.resolve(network, period, given))


def _resolve_ekf(network: Network, period: float, given: Mapping[str, object]) -> Mapping[str, object]:
    return augmented_options.as_mapping(augmented_options.resolve_ekf(network, period, given))


def _build_ekf(network: Network, period: float, given: Mapping[str, object]) -> Estimator:
    return ekf(network, period, augmented_options.resolve_ekf(network, period, given))


def _resolve_ukf(network: Network, period: float, given: Mapping[str, object]) -> Mapping[str, object]:
    return augmented_options.as_mapping(augmented_options.resolve_ukf(network, period, given))


def _build_ukf(network: Network, period: float, given: Mapping[str, object]) -> Estimator:
    return ukf(network, period, augmented_options.resolve_ukf(network, period, given))


def _resolve_mkf(network: Network, period: float, given: Mapping[str, object]) -> Mapping[str, object]:
    return mkf_options.as_mapping(mkf_options.resolve(network, period, given))


def _build_mkf(network: Network, period: float, given: Mapping[str, object]) -> Estimator:
    return MKF(network, period, mkf_options.resolve(network, period, given))


ESTIMATORS: dict[str, _Entry] = {
    "rbpf": _Entry(_resolve_rbpf, _build_rbpf),
    "ekf": _Entry(_resolve_ekf, _build_ekf),
    "ukf": _Entry(_resolve_ukf, _build_ukf),
    "mkf": _Entry(_resolve_mkf, _build_mkf),
}


def resolve_options(
    estimator: str, network: Network, period: float, given: Mapping[str, object]
) -> Mapping[str, object]:
    """The options in force, defaults filled; OptionsError names the estimator or option that does not exist or fit."""
    return _entry(estimator).resolve(network, period, given)


def build(estimator: str, network: Network, period: float, given: Mapping[str, object]) -> Estimator:
    """The estimator called `estimator` for `network` at `period` s with options `given`."""
    return _entry(estimator).build(network, period, given)


def _entry(estimator: str) -> _Entry:
    if estimator not in ESTIMATORS:
        raise OptionsError(f"unknown estimator '{estimator}'; the estimators are {', '.join(ESTIMATORS)}")
    return ESTIMATORS[estimator]
