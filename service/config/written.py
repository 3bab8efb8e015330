"""A configuration written out again as TOML."""

from collections.abc import Mapping
from typing import Any

import tomli_w

from estimator.heat.terms import CLEAR, DIFFUSE, HABIT_HOURS, SUN_HOURS
from estimator.network.network import HeatInput, Network, Parameter
from estimator.registry import written
from service.config.known_heat import OF_THE_ENVELOPE
from service.config.site import TABLES, Config


def effective_toml(config: Config) -> str:
    """`config` as TOML that `load` accepts, with every default, network parameter and estimator option written out."""
    resolved = {"zones": {"__all__": {"network", "options", "proposes_bounds", "whereabouts"}}}
    dumped = config.model_dump(mode="json", exclude_none=True, exclude=resolved)
    shown = dumped | dumped["sinks"]
    tables = {name: shown[name] for name in TABLES if name in shown}
    if config.http.socket is not None:
        # It takes the place of what is there by default.
        tables["http"] = {name: value for name, value in tables["http"].items() if name not in ("host", "port")}
    for table, zone in zip(tables["zones"], config.zones, strict=True):
        table["network"] = network_table(zone.network)
        for key, value in _known_heat(zone.network).items():
            table.pop(key, None)
            table[key] = value
        # What they say of the envelope is in the network.
        for key in OF_THE_ENVELOPE:
            table.pop(key, None)
        table["estimator_options"] = _plain(written(zone.estimator, zone.options))
    return tomli_w.dumps(tables)


def _known_heat(network: Network) -> dict[str, Any]:
    """The keys of a zone that give `network` its terms."""
    series = {term.series for term in network.terms}
    by = {"facades": DIFFUSE, "hours": f"sun_{SUN_HOURS[0]:02}", "clear-sky": CLEAR + DIFFUSE}
    return {
        "habits": f"habit_{HABIT_HOURS[0]:02}" in series,
        "sun": next((kind for kind, mark in by.items() if mark in series), False),
    }


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
    known = {"nominal": parameter.nominal, "typical": parameter.typical}
    if parameter.typical is not None and parameter.spread != 1.0:
        known["spread"] = parameter.spread
    return bounds | {name: value for name, value in known.items() if value is not None}


def _gain(network: Network, heat: HeatInput) -> Any:
    gain = heat.gain
    if gain.parameter is None:
        return gain.constant
    if gain.sign < 0:
        return {"rest_of": gain.parameter}
    parameter = network.parameter(gain.parameter)
    return {"name": parameter.name, "unit": parameter.unit, **_bounds(parameter)}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items() if item is not None}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
