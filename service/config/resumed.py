"""Zones that have learned with what their tables once meant go on with it: members of a bank, sun and habits."""

from collections.abc import Mapping
from pathlib import Path

from adapters.fields.problems import Problems
from estimator import registry
from estimator.bank.options import former_members
from estimator.network.network import Network
from service.config.fitting import fingerprint
from service.config.known_heat import heated
from service.config.site import DEFAULT_ESTIMATOR, ZoneConfig
from service.store.reading import stored_fingerprints


def resumed(zones: tuple[ZoneConfig, ...], state_dir: Path) -> tuple[ZoneConfig, ...]:
    """`zones`, those that leave it open as they were when their state in `state_dir` was written."""
    former = {zone.id: found for zone in zones if (found := _former(zone))}
    stored = stored_fingerprints(state_dir) if former else {}
    found = []
    for zone in zones:
        mark = stored.get(zone.id)
        known = () if mark is None else (zone, *former.get(zone.id, ()))
        found.append(next((one for one in known if fingerprint(one) == mark), zone))
    return tuple(found)


def _former(zone: ZoneConfig) -> list[ZoneConfig]:
    """What the table of `zone` may have meant before, where that was something else."""
    networks, given = [zone.network], zone.estimator_options
    if zone.network.terms and zone.habits is None and zone.sun is None:
        bare, nowhere = zone.network.without_terms(), zone.whereabouts._replace(location=None)
        # Where the site had no location yet, the sun came by the hour. Members that are named may need terms.
        networks += [heated(bare, zone, nowhere, (), Problems({})), *([] if "members" in given else [bare])]
    found = [_with(zone, network, given) for network in networks[1:]]
    if zone.estimator == DEFAULT_ESTIMATOR and "members" not in given:
        found += [
            _with(zone, network, {**given, "members": former})
            for network in networks
            for former in former_members(network)
        ]
    return found


def _with(zone: ZoneConfig, network: Network, given: Mapping[str, object]) -> ZoneConfig:
    options = registry.resolve(zone.estimator, network, zone.period, given)
    return zone.model_copy(update={"network": network, "options": options})
