"""From the network table of a zone to the estimator's `Network`."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from adapters.fields.problems import Place, Problems
from adapters.fields.words import shown, suggestion
from estimator.errors import NetworkError
from estimator.network import presets
from estimator.network.boxes import box, boxed, is_generic
from estimator.network.network import Conductance, Gain, HeatInput, InitialTemperature, Network, Parameter
from estimator.network.presets import AUTO, CLOUDS, SOLAR_APERTURE, SUN
from service.config.network_tables import (
    SPREAD_ALONE,
    BoundsConfig,
    GainConfig,
    InitialConfig,
    InlineConfig,
    NetworkConfig,
    PresetConfig,
    SolarConfig,
    network_model,
)
from service.config.overrides import apply_overrides
from service.errors import ConfigError

Mistakes = dict[Place, str]
"""What is wrong inside a network table, by its place there."""


def read_network(
    raw: object, place: Place, problems: Problems, context: Mapping[str, Any], channels: Collection[str] = ()
) -> tuple[NetworkConfig | None, Network | None]:
    """The network table `raw` at `place`, and its network in a zone with `channels`; mistakes go to `problems`."""
    if not isinstance(raw, str | dict):
        problems.add(place, f'must be a preset such as "titeth", or a [zones.network] table, not {shown(raw)}')
        return None, None
    model, long_form = network_model(raw)
    table = problems.read(model, long_form, place, context)
    if table is None:
        return None, None
    network, mistakes = resolve(table, channels)
    for inside, sentence in mistakes.items():
        problems.add((*place, *inside), sentence)
    return table, network


def preset_network(name: str, overrides: Sequence[str]) -> Network:
    """The preset `name` with changes such as "solar=true"; ConfigError with every mistake in them."""
    raw = apply_overrides({"preset": name}, overrides)
    problems = Problems(raw)
    network = read_network(raw, (), problems, {})[1]
    if network is None or problems.sentences:
        raise ConfigError(problems.sentences)
    return network


def resolve(table: NetworkConfig, channels: Collection[str] = ()) -> tuple[Network | None, Mistakes]:
    """The network that `table` describes in a zone that has `channels`, validated if there are no mistakes.

    With mistakes it is good for its channels only, and None where not even those are certain.
    """
    mistakes: Mistakes = {}
    network = _from_preset(table, channels, mistakes) if isinstance(table, PresetConfig) else _inline(table, mistakes)
    if network is not None:
        network = _with_initial(network, table.initial, mistakes)
    if network is not None and not mistakes:
        try:
            network.validate()
        except NetworkError as error:
            return None, {(): str(error)}
    return network, mistakes


def proposes_bounds(table: NetworkConfig) -> bool:
    """Whether a zone with the network in `table` is to propose narrower bounds after its first week."""
    if not isinstance(table, PresetConfig):
        return False
    return table.preset == AUTO if table.box is None else table.box.propose


def _from_preset(table: PresetConfig, channels: Collection[str], mistakes: Mistakes) -> Network | None:
    if table.preset not in presets.PRESETS:
        mistakes[("preset",)] = (
            f'unknown network "{table.preset}"; {suggestion(table.preset, presets.PRESETS, "the presets are")}'
        )
        return None
    network = presets.network(table.preset)
    if table.preset == AUTO:
        # What the table says of the sun replaces what follows from the channels.
        network = presets.automatic([name for name in channels if name not in (SUN, CLOUDS) or table.solar is None])
    if table.box is not None:
        if not is_generic(network):
            mistakes[("box",)] = (
                f'network "{network.name}" is one building, whose bounds do not follow from a floor area; remove box'
            )
            return network
        network = boxed(network, *table.box.floor_area)
    if table.solar is not None:
        aperture = SOLAR_APERTURE if table.box is None else box(SOLAR_APERTURE, *table.box.floor_area)
        shone_upon = _with_solar(network, aperture, table.solar, mistakes)
        if shone_upon is None:
            return None
        network = shone_upon
    names = [parameter.name for parameter in network.parameters]
    for name, bounds in table.parameters.items():
        if name not in names:
            mistakes["parameters", name] = _no_parameter(network, name)
            continue
        changed = _changed(network.parameter(name), bounds)
        problem = _bounds_problem(changed, "the preset's")
        if problem and name not in table.fixed:
            mistakes["parameters", name] = problem
        network = replace(network, parameters=tuple(changed if p.name == name else p for p in network.parameters))
    for index, name in enumerate(table.fixed):
        if name not in names:
            mistakes["fixed", index] = _no_parameter(network, name)
        elif network.parameter(name).nominal is None:
            mistakes["fixed", index] = (
                f"{name} has no nominal value to hold it at; write parameters.{name} = {{ value = ... }} instead"
            )
        else:
            network = network.with_fixed([name])
    return network


def _bounds_problem(parameter: Parameter, default: str) -> str | None:
    """What is wrong with the bounds of a free parameter, of which only some may have been given."""
    lower, upper = parameter.lower, parameter.upper
    remedy = f"a bound that is left out stays {default}, so give both"
    if not parameter.free:
        return None
    if lower >= upper:
        return f"lower = {lower:g} is not below upper = {upper:g}; {remedy}"
    for name, value in (("nominal", parameter.nominal), ("typical", parameter.typical)):
        if value is not None and not lower <= value <= upper:
            return f"{name} = {value:g} lies outside the bounds {lower:g} and {upper:g}; {remedy}"
    return SPREAD_ALONE if parameter.typical is None and parameter.spread != 1.0 else None


def _no_parameter(network: Network, name: str) -> str:
    known = suggestion(name, (parameter.name for parameter in network.parameters), "its parameters are")
    return f'network "{network.name}" has no parameter "{name}"; {known}'


def _with_solar(network: Network, aperture: Parameter, solar: SolarConfig, mistakes: Mistakes) -> Network | None:
    node = solar.node or network.measured[0]
    if node not in network.nodes:
        known = suggestion(node, network.nodes, "the state nodes are")
        mistakes["solar", "node"] = f'"{node}" is not a state node; {known}'
        return None
    default = f"at {aperture.lower:g} or {aperture.upper:g} m2"
    aperture = _changed(aperture, solar)
    wrong = _bounds_problem(aperture, default)
    if wrong:
        mistakes[("solar",)] = wrong
        return None
    try:
        return network.with_solar(node, aperture)
    except NetworkError as error:
        mistakes[("solar",)] = f"{error}; remove solar"
        return None


def _changed(parameter: Parameter, bounds: BoundsConfig) -> Parameter:
    """`parameter` with what `bounds` says; a nominal or typical value that its new bounds exclude is dropped."""
    if bounds.value is not None:
        return replace(parameter, nominal=bounds.value, free=False, typical=None)
    names = ("lower", "upper", "nominal", "typical", "spread")
    given: dict[str, Any] = {name: value for name in names if (value := getattr(bounds, name)) is not None}
    new = replace(parameter, **given)
    kept = {name: getattr(new, name) for name in ("nominal", "typical") if name not in given}
    outside = [name for name, value in kept.items() if value is not None and not new.lower <= value <= new.upper]
    return replace(new, **dict[str, Any](dict.fromkeys(outside)))


def _inline(table: InlineConfig, mistakes: Mistakes) -> Network:
    capacitances = {node: bounds.name or f"C_{node.removeprefix('T_')}" for node, bounds in table.capacitances.items()}
    parameters = [_parameter(capacitances[node], "J/K", bounds) for node, bounds in table.capacitances.items()]
    parameters += [_parameter(edge.name, "W/K", edge) for edge in table.conductances]
    for heat in table.heat_inputs:
        if heat.gain.name is not None:
            unit = heat.gain.unit or {"W": "1", "W/m2": "m2"}.get(heat.unit, f"W per {heat.unit}")
            parameters.append(_parameter(heat.gain.name, unit, heat.gain))
    gains = [heat.gain.name for heat in table.heat_inputs if heat.gain.name is not None]
    for index, heat in enumerate(table.heat_inputs):
        if heat.gain.rest_of is not None and heat.gain.rest_of not in gains:
            known = suggestion(heat.gain.rest_of, gains, "the named gains are")
            mistakes["heat_inputs", index, "gain", "rest_of"] = (
                f'no heat input has a gain called "{heat.gain.rest_of}"; {known}'
            )
    known_nodes = (*table.capacitances, *table.boundaries)
    for index, edge in enumerate(table.conductances):
        for end, node in enumerate(edge.between):
            if node not in known_nodes:
                mistakes["conductances", index, "between", end] = _no_node(node, known_nodes)
    for index, heat in enumerate(table.heat_inputs):
        if heat.node not in table.capacitances:
            mistakes["heat_inputs", index, "node"] = _no_node(heat.node, tuple(table.capacitances))
    return Network(
        name=table.name,
        capacitances=capacitances,
        boundaries=table.boundaries,
        conductances=tuple(Conductance(edge.name, edge.between) for edge in table.conductances),
        heat_inputs=tuple(
            HeatInput(heat.channel, heat.node, _gain(heat.gain), heat.unit) for heat in table.heat_inputs
        ),
        parameters=tuple(parameters),
        measured=table.measured,
    )


def _no_node(node: str, known: tuple[str, ...]) -> str:
    return f"unknown node {shown(node)}; {suggestion(node, known, 'the nodes here can be')}"


def _parameter(name: str, unit: str, bounds: BoundsConfig) -> Parameter:
    if bounds.value is not None:
        return Parameter(name, unit, bounds.value, bounds.value, bounds.value, free=False)
    if bounds.lower is None or bounds.upper is None:
        raise AssertionError("the model of an inline parameter asks for a value or both bounds")
    spread = 1.0 if bounds.spread is None else bounds.spread
    return Parameter(name, unit, bounds.lower, bounds.upper, bounds.nominal, typical=bounds.typical, spread=spread)


def _gain(gain: GainConfig) -> Gain:
    if gain.rest_of is not None:
        return Gain(1.0, gain.rest_of, -1.0)
    return Gain(parameter=gain.name) if gain.name is not None else Gain(gain.constant or 0.0)


def _with_initial(network: Network, initial: Mapping[str, InitialConfig], mistakes: Mistakes) -> Network:
    rules = dict(network.initial)
    for node, table in initial.items():
        if node not in network.nodes:
            known = suggestion(node, network.nodes, "the state nodes are")
            mistakes["initial", node] = f'"{node}" is not a state node; {known}'
            continue
        if isinstance(table.source, str) and table.source not in ("measured", *network.boundaries):
            known = suggestion(table.source, ("measured", *network.boundaries), "it can be a number in degC or one of")
            mistakes["initial", node, "source"] = f'"{table.source}" is no starting point; {known}'
            continue
        rule = network.initial_temperature(node)
        rules[node] = InitialTemperature(
            rule.source if table.source is None else table.source, rule.sd if table.sd is None else table.sd
        )
    return replace(network, initial=rules)
