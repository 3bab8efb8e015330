"""The zone of a configuration that an experiment is about."""

from replay.errors import ReplayError
from replay.experiments.request import Request
from service.config.load import load
from service.config.site import Config, ZoneConfig


def chosen(request: Request) -> tuple[Config, ZoneConfig]:
    """The configuration of `request`, and the zone that --zone names in it, or its only one; ReplayError or ConfigError
    says what is wrong."""
    path = request.configuration
    if path is None:
        raise ReplayError("there is no configuration; name one with --config")
    config = load(path, request.overrides)
    zones = {zone.id: zone for zone in config.zones}
    if request.zone is None and len(zones) == 1:
        return config, config.zones[0]
    if request.zone not in zones:
        wrong = f"there is no zone '{request.zone}'" if request.zone else "it has several zones; choose one with --zone"
        raise ReplayError(f"{path}: {wrong}; the zones are {', '.join(zones)}")
    return config, zones[request.zone]
