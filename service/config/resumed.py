"""Zones that have learned with the former members of a default bank go on with these."""

from __future__ import annotations

from pathlib import Path

from estimator import registry
from estimator.bank.options import former_members
from service.config.fitting import fingerprint
from service.config.site import DEFAULT_ESTIMATOR, ZoneConfig
from service.store.reading import stored_fingerprints


def resumed(zones: tuple[ZoneConfig, ...], state_dir: Path) -> tuple[ZoneConfig, ...]:
    """`zones`, those that name no members with the ones that their state in `state_dir` was written with."""
    former = {zone.id: _former(zone) for zone in zones if _names_no_members(zone)}
    stored = stored_fingerprints(state_dir) if former else {}
    return tuple(
        former[zone.id] if zone.id in former and stored.get(zone.id) == fingerprint(former[zone.id]) else zone
        for zone in zones
    )


def _names_no_members(zone: ZoneConfig) -> bool:
    return zone.estimator == DEFAULT_ESTIMATOR and "members" not in zone.estimator_options


def _former(zone: ZoneConfig) -> ZoneConfig:
    given = {**zone.estimator_options, "members": former_members(zone.network)}
    options = registry.resolve(DEFAULT_ESTIMATOR, zone.network, zone.period, given)
    return zone.model_copy(update={"options": options})
