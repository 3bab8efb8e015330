"""Zones that have learned with what their tables meant before go on with it: sun and habits."""

from collections.abc import Iterator
from pathlib import Path

from adapters.fields.problems import Problems
from estimator import registry
from service.config.fitting import fingerprint
from service.config.known_heat import heated
from service.config.site import ZoneConfig
from service.store.reading import stored_fingerprints


def resumed(zones: tuple[ZoneConfig, ...], state_dir: Path) -> tuple[ZoneConfig, ...]:
    """`zones`, those that leave it open as they were when their state in `state_dir` was written."""
    open_to = [zone for zone in zones if zone.network.terms and zone.habits is None and zone.sun is None]
    stored = stored_fingerprints(state_dir) if open_to else {}
    former = {zone.id: _former(zone) for zone in open_to if stored.get(zone.id) not in (None, fingerprint(zone))}
    return tuple(
        next((one for one in former.get(zone.id, ()) if fingerprint(one) == stored[zone.id]), zone) for zone in zones
    )


def _former(zone: ZoneConfig) -> Iterator[ZoneConfig]:
    """What the table of `zone` may have meant before."""
    bare, nowhere = zone.network.without_terms(), zone.whereabouts._replace(location=None)
    # Where the site had no location yet, the sun came by the hour. Members that are named may need terms.
    networks = [heated(bare, zone, nowhere, (), Problems({})), bare]
    for network in networks[: 1 if "members" in zone.estimator_options else 2]:
        options = registry.resolve(zone.estimator, network, zone.period, zone.estimator_options)
        yield zone.model_copy(update={"network": network, "options": options})
