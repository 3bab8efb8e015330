"""What the command line shows: the effective configuration, the summary of a check, and the presets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import tomli_w

from estimator import presets
from estimator.network import HeatInput, Network, Parameter
from estimator.registry import resolve_options
from service.config_models import Config, ZoneConfig
from service.durations import format_duration
from service.networks import build_network


def effective_toml(config: Config) -> str:
    """`config` as TOML that `load` accepts, with every default, network parameter and estimator option written out."""
    tables = config.model_dump(mode="json", exclude_none=True)
    for table, zone in zip(tables["zones"], config.zones, strict=True):
        network = build_network(zone)
        table["network"] = network_table(network)
        table["estimator_options"] = _plain(
            resolve_options(zone.estimator, network, zone.period, zone.estimator_options)
        )
    return tomli_w.dumps(tables)


def network_table(network: Network) -> dict[str, Any]:
    """The inline [zones.network] table that describes `network`, presets included."""
    return {
        "name": network.name,
        "measured": list(network.measured),
        "boundaries": list(network.boundaries),
        "capacitances": {
            node: {"name": name, **_bounds(network.parameter(name))} for node, name in network.capacitances.items()
        },
        "conductances": [
            {"name": edge.name, "between": list(edge.between), **_bounds(network.parameter(edge.name))}
            for edge in network.conductances
        ],
        "heat_inputs": [
            {"channel": heat.channel, "node": heat.node, "unit": heat.unit, "gain": _gain(network, heat)}
            for heat in network.heat_inputs
        ],
        "initial": {
            node: {"source": rule.source, "sd": rule.sd}
            for node, rule in ((node, network.initial_temperature(node)) for node in network.nodes)
        },
    }


def _bounds(parameter: Parameter) -> dict[str, float]:
    if not parameter.free:
        return {} if parameter.nominal is None else {"value": parameter.nominal}
    bounds = {"lower": parameter.lower, "upper": parameter.upper}
    return bounds if parameter.nominal is None else bounds | {"nominal": parameter.nominal}


def _gain(network: Network, heat: HeatInput) -> Any:
    gain = heat.gain
    if gain.parameter is None:
        return gain.constant
    if gain.sign < 0:
        return {"rest_of": gain.parameter}
    parameter = network.parameter(gain.parameter)
    return {"name": parameter.name, "unit": parameter.unit, **_bounds(parameter)}


def _plain(value: Any) -> Any:
    """`value` in the types TOML has."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items() if item is not None}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def summary(config: Config) -> list[str]:
    """What a configuration that passed its check will run, line by line."""
    lines = [
        f"OK: site '{config.site.id}', {_count(config.zones, 'zone')}, {_count(config.sources, 'source')}; "
        f"state in {config.site.state_dir}"
    ]
    for name, source in config.sources.items():
        lines.append(f"source {name}: {source.kind}, {source.described}")
    for zone in config.zones:
        lines += _zone_summary(zone)
    return lines


def _zone_summary(zone: ZoneConfig) -> list[str]:
    network = build_network(zone)
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
    for name in network.channels:
        channel = zone.channels[name]
        unit, given = network.channel_unit(name), f"{channel.address} [{channel.unit}] from {channel.source}"
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
    return [title, f"states: {', '.join(network.nodes)}", f"channels: {channels}", *aligned(rows)]


def aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """The rows of a table as lines, every column as wide as its widest cell."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(_padded(row, widths)).rstrip() for row in rows]


def _padded(row: Sequence[str], widths: Sequence[int]) -> Iterable[str]:
    return (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
