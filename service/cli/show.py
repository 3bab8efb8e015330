"""What the commands show: the summary of a check, where a demo is to be seen, and the network presets."""

import shlex
from collections.abc import Mapping, Sequence

from adapters.fields.durations import format_duration
from estimator.network import presets
from estimator.network.family import family
from estimator.network.network import Network
from service.cli.tables import aligned
from service.config.site import Config, ZoneConfig
from service.zone.alignment import SETPOINT, unit_of


def summary(config: Config) -> list[str]:
    """What a configuration that passed its check will run, line by line."""
    lines = [
        f"OK: site '{config.site.id}', {_count(config.zones, 'zone')}, {_count(config.sources, 'source')}; "
        f"state in {config.site.state_dir}"
    ]
    for name, source in config.sources.items():
        lines.append(f"source {name}: {source.kind}, {source.described}")
    for name, weather in config.weather.items():
        lines.append(f"weather {name}: {weather.kind}, {weather.described}")
    for zone in config.zones:
        lines += _zone_summary(zone)
    return lines


def _zone_summary(zone: ZoneConfig) -> list[str]:
    network = zone.network
    free = [parameter.name for parameter in network.free]
    fixed = [parameter.name for parameter in network.parameters if not parameter.free]
    lines = [
        f"zone {zone.id}: network {network.name}, estimator {zone.estimator}, "
        f"a sample every {format_duration(zone.period)}",
        f"  states: {', '.join(network.nodes)}",
        f"  free parameters ({len(free)}): {', '.join(free) or 'none'}",
    ]
    if fixed:
        lines.append(f"  fixed parameters ({len(fixed)}): {', '.join(fixed)}")
    for name, channel in sorted(zone.delivered.items(), key=lambda one: (*network.channels, SETPOINT).index(one[0])):
        unit, given = unit_of(network, name), f"{channel.address} [{channel.unit}] from {channel.source}"
        lines.append(f"  {name} [{unit}]: {channel.aggregate} of {given}")
    return lines


def demo_requests(config: Config) -> list[str]:
    """Where the demo is to be seen, and what to ask it."""
    host = f"[{config.http.host}]" if ":" in config.http.host else config.http.host
    url = f"{'http' if config.http.certificate is None else 'https'}://{host}:{config.http.port}"
    zone = config.zones[0].id
    lines = [f"Thermogate demo: a simulated building with the zones {', '.join(zone.id for zone in config.zones)}"]
    if config.http.port == 0:
        return [*lines, "The port is chosen now and said in the log below; Ctrl-C stops."]
    return [
        *lines,
        f"Open {url}/ for the live page, {url}/docs for the API, or ask:",
        f"  curl '{url}/zones'",
        f"  curl '{url}/zones/{zone}/forecast?level=0.5&level=0.95'",
        f"  curl '{url}/zones/{zone}/parameters'",
        f"For its report, while it runs: thermogate report {shlex.quote(str(config.site.state_dir))}",
        "Ctrl-C stops.",
    ]


def _count(things: Sequence[object] | Mapping[str, object], noun: str) -> str:
    return f"{len(things)} {noun}{'' if len(things) == 1 else 's'}"


def preset_table() -> list[str]:
    """The presets, one per line, with their states, inputs and number of parameters."""
    rows = [("network", "states", "inputs", "parameters", "what it is")]
    for name in presets.PRESETS:
        network = presets.network(name)
        states, inputs = ", ".join(network.nodes), ", ".join(network.inputs)
        rows.append((name, states, inputs, str(len(network.parameters)), network.description))
    return aligned(rows)


def parameter_table(network: Network) -> list[str]:
    """A network's channels, and its parameters one per line."""
    rows = [("parameter", "unit", "lower", "upper", "nominal", "free")]
    for parameter in network.parameters:
        bounds = (f"{parameter.lower:.6g}", f"{parameter.upper:.6g}") if parameter.free else ("-", "-")
        nominal = "-" if parameter.nominal is None else f"{parameter.nominal:.6g}"
        rows.append((parameter.name, parameter.unit, *bounds, nominal, "yes" if parameter.free else "no"))
    channels = ", ".join(f"{channel} [{network.channel_unit(channel)}]" for channel in network.channels)
    title = f"{network.name}: {network.description}" if network.description else network.name
    variants = f"variants for members of a bank: {', '.join(family(network))}"
    return [title, f"states: {', '.join(network.nodes)}", f"channels: {channels}", variants, *aligned(rows)]
