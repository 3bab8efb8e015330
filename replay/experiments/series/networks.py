"""Which network an experiment is about: its own, a preset with changes, or that of a zone in a configuration."""

from __future__ import annotations

from estimator.network.network import Network
from replay.errors import ReplayError
from replay.experiments.request import Request
from service.config.load import load
from service.config.networks import preset_network
from service.config.site import Config, ZoneConfig


def network_of(request: Request, default: str) -> Network:
    """The network asked for, the preset `default` if none was; ReplayError or ConfigError says what is wrong."""
    if request.config is None:
        return preset_network(request.network or default, request.overrides)
    if request.network is not None:
        raise ReplayError("--network and --config both name a network; give one of them")
    return zone_of(request).network


def zone_of(request: Request) -> ZoneConfig:
    """The zone of --config that --zone names, or its only one; ReplayError or ConfigError says what is wrong."""
    return chosen(request)[1]


def chosen(request: Request) -> tuple[Config, ZoneConfig]:
    """As `zone_of`, with the configuration."""
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
