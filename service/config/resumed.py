"""Zones that name no estimator and have learned with the one that was the default before go on with it."""

from __future__ import annotations

from pathlib import Path

from estimator import registry
from service.config.fitting import fingerprint
from service.config.site import FORMER_ESTIMATOR, ZoneConfig
from service.store.reading import stored_fingerprints


def resumed(zones: tuple[ZoneConfig, ...], state_dir: Path) -> tuple[ZoneConfig, ...]:
    """`zones`, those without an estimator of their own with the one that their state in `state_dir` belongs to."""
    open_ones = [zone for zone in zones if "estimator" not in zone.model_fields_set]
    stored = stored_fingerprints(state_dir) if open_ones else {}
    former = {
        zone.id: as_before for zone in open_ones if fingerprint(as_before := _former(zone)) == stored.get(zone.id)
    }
    return tuple(former.get(zone.id, zone) for zone in zones)


def _former(zone: ZoneConfig) -> ZoneConfig:
    options = registry.resolve(FORMER_ESTIMATOR, zone.network, zone.period, {})
    return zone.model_copy(update={"estimator": FORMER_ESTIMATOR, "options": options})
