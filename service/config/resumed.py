"""Zones that have learned with what was the default before go on with it: estimator, members, no sun and no habits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from adapters.fields.problems import Problems
from estimator import registry
from estimator.bank.options import former_members
from estimator.network.network import Network
from service.config.fitting import fingerprint
from service.config.known_heat import heated
from service.config.site import DEFAULT_ESTIMATOR, FORMER_ESTIMATOR, ZoneConfig
from service.store.reading import stored_fingerprints


def resumed(zones: tuple[ZoneConfig, ...], state_dir: Path) -> tuple[ZoneConfig, ...]:
    """`zones`, those that leave it open as they were when their state in `state_dir` was written."""
    former = {zone.id: found for zone in zones if (found := _former(zone))}
    stored = stored_fingerprints(state_dir) if former else {}
    return tuple(_going_on(zone, former.get(zone.id, []), stored.get(zone.id)) for zone in zones)


def _going_on(zone: ZoneConfig, former: Sequence[ZoneConfig], stored: str | None) -> ZoneConfig:
    """The one of `zone` and what it was in former versions to which the `stored` state belongs."""
    if stored is None or fingerprint(zone) == stored:
        return zone
    return next((as_before for as_before in former if fingerprint(as_before) == stored), zone)


def _former(zone: ZoneConfig) -> list[ZoneConfig]:
    """What the table of `zone` meant in former versions, where that was something else."""
    found = []
    network, given = zone.network, zone.estimator_options
    if network.terms and zone.habits is None and zone.sun is None:
        network = network.without_terms()
        nowhere = zone.whereabouts._replace(location=None)
        # Where the site had no location yet, the sun came by the hour.
        for before in (heated(network, zone, nowhere, (), Problems({})), network):
            found.append(_with(zone, before, zone.estimator, given))
    if zone.estimator == DEFAULT_ESTIMATOR and "members" not in given:
        found.append(_with(zone, network, DEFAULT_ESTIMATOR, {**given, "members": former_members(network)}))
    if "estimator" not in zone.model_fields_set:
        found.append(_with(zone, network, FORMER_ESTIMATOR, {}))
    return found


def _with(zone: ZoneConfig, network: Network, estimator: str, given: Mapping[str, object]) -> ZoneConfig:
    options = registry.resolve(estimator, network, zone.period, given)
    return zone.model_copy(update={"network": network, "estimator": estimator, "options": options})
