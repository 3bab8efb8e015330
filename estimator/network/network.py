"""RC thermal networks as data (paper 3.1).

A network names its state nodes (each with a capacitance), its boundary nodes (prescribed temperatures), the
conductances between nodes, the heat inputs with fixed or free gains, and the measured nodes. From those it names the
entries of theta with unit, bounds and whether they are free. Nothing here computes; `assembly` builds the matrices.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from estimator.arrays import Indices
from estimator.errors import NetworkError
from estimator.network.terms import HeatTerm

MEASURED = "measured"

SHARE = "share_"
"""Before the name of a heat input that is a meter of several zones: the parameter that is this zone's share of it."""
_SMALLEST_SHARE = 1e-3
_SPREAD_OF_SHARES = 0.5
"""Rooms differ in use, walls and what their neighbours give them: two of three have within 1.6 times what is likely."""


@dataclass(frozen=True)
class Parameter:
    """One entry of theta: a capacitance [J/K], a conductance [W/K] or the gain of a heat input.

    `lower` and `upper` are the box that a free parameter is learned in; one that is not free stays at `nominal`. A
    priori it is log-uniform on the box (23), or, where a `typical` value is known, log-normal about it with `spread`,
    the standard deviation of its logarithm: by default a factor of e, 2.7.
    """

    name: str
    unit: str
    lower: float
    upper: float
    nominal: float | None = None
    free: bool = True
    typical: float | None = None
    spread: float = 1.0


@dataclass(frozen=True)
class Conductance:
    """A thermal conductance between two nodes, at least one of them a state node; its parameter has the same name."""

    name: str
    between: tuple[str, str]


@dataclass(frozen=True)
class Gain:
    """Watts into a node per unit of a heat-input channel: `constant + sign * theta[parameter]`.

    `Gain(1.0)` is a heater in W; `Gain(parameter="A_w")` a solar aperture; `Gain(1.0, "f_air", -1.0)` what is left of
    a heater when the share `f_air` goes elsewhere.
    """

    constant: float = 0.0
    parameter: str | None = None
    sign: float = 1.0


@dataclass(frozen=True)
class HeatInput:
    """A measured heat flow: `channel`, in `unit`, times `gain`, enters `node`."""

    channel: str
    node: str
    gain: Gain = Gain(1.0)
    unit: str = "W"


@dataclass(frozen=True)
class InitialTemperature:
    """Where a state node starts, and how widely.

    `source` is "measured" (the first measured output), the name of a boundary node, or a temperature in degC.
    `sd` is the standard deviation in K.
    """

    source: str | float = MEASURED
    sd: float = 2.0


@dataclass(frozen=True)
class Network:
    """An RC network. Build one, then `validate()` it; presets and configuration do both.

    `capacitances` maps each state node to the name of its parameter; its order is the order of the state vector x.
    The input vector u is `boundaries` followed by `heat_channels` (paper 3.1); the output vector y is `measured`.
    """

    name: str
    capacitances: Mapping[str, str]
    boundaries: Sequence[str]
    conductances: Sequence[Conductance]
    heat_inputs: Sequence[HeatInput]
    parameters: Sequence[Parameter]
    measured: Sequence[str]
    initial: Mapping[str, InitialTemperature] = field(default_factory=dict)
    description: str = ""
    terms: tuple[HeatTerm, ...] = ()
    """Heat that is known up to coefficients."""

    def __hash__(self) -> int:
        # The members of a bank have networks of one name, which are compared field by field where hashes are equal.
        return hash((self.name, len(self.heat_inputs), len(self.terms)))

    @cached_property
    def nodes(self) -> tuple[str, ...]:
        """State nodes, in the order of x."""
        return tuple(self.capacitances)

    @cached_property
    def heat_channels(self) -> tuple[str, ...]:
        """Heat-input channels in first-use order; one channel may feed several nodes."""
        return tuple(dict.fromkeys(heat.channel for heat in self.heat_inputs))

    @cached_property
    def clouds(self) -> str | None:
        """The input [%] that dims the sun of a clear sky, and brings no heat by itself; None without one."""
        return next((heat.channel for heat in self.heat_inputs if heat.unit == "%" and heat.gain == Gain(0.0)), None)

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """Channels of the input vector u: boundary temperatures, then heat inputs."""
        return (*self.boundaries, *self.heat_channels)

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Every channel that a zone with this network needs: outputs, then inputs."""
        return (*self.measured, *self.inputs)

    @property
    def free(self) -> tuple[Parameter, ...]:
        """The parameters that are learned, in the order of theta."""
        return tuple(parameter for parameter in self.parameters if parameter.free)

    @cached_property
    def drive(self) -> tuple[str, ...]:
        """What drives the network over a step: the input vector u, then the known f of every term."""
        return (*self.inputs, *(term.name for term in self.terms))

    def columns(self, part: Network) -> Indices:
        """The places in a drive row of this network of what drives `part`, which has the same inputs and no term that
        this one lacks."""
        return np.array([self.drive.index(name) for name in part.drive], dtype=np.int64)

    @cached_property
    def shares(self) -> Mapping[str, int]:
        """The heat inputs that are meters of several zones, with the place in theta of this zone's share."""
        places = {parameter.name: place for place, parameter in enumerate(self.parameters)}
        named = {channel: SHARE + channel for channel in self.heat_channels}
        return {channel: places[name] for channel, name in named.items() if name in places}

    def without_terms(self) -> Network:
        """A copy in which all heat is measured or unknown."""
        return replace(self, terms=()) if self.terms else self

    def channel_unit(self, channel: str) -> str:
        """The unit that `channel` must arrive in: degC for temperatures, the declared unit for heat inputs."""
        for heat in self.heat_inputs:
            if heat.channel == channel:
                return heat.unit
        if channel in self.channels:
            return "degC"
        raise NetworkError(f"network '{self.name}' has no channel '{channel}'; it has {_listed(self.channels)}")

    def parameter(self, name: str) -> Parameter:
        """The parameter called `name`."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise NetworkError(
            f"network '{self.name}' has no parameter '{name}'; it has {_listed(p.name for p in self.parameters)}"
        )

    def with_parameter(self, name: str, **changes: object) -> Network:
        """A copy in which parameter `name` has other bounds, another nominal value, or is (not) free."""
        changed = replace(self.parameter(name), **changes)  # type: ignore[arg-type]
        return replace(self, parameters=tuple(changed if p.name == name else p for p in self.parameters))

    def with_fixed(self, names: Iterable[str]) -> Network:
        """A copy in which the named parameters are held at their nominal values."""
        network = self
        for name in names:
            network = network.with_parameter(name, free=False)
        return network

    def with_solar(self, node: str, aperture: Parameter, channel: str = "I_sol") -> Network:
        """A copy with global irradiance [W/m2] entering `node` through a solar aperture [m2]."""
        if channel in self.heat_channels:
            raise NetworkError(f"network '{self.name}' already has the heat input '{channel}'")
        heat = HeatInput(channel, node, Gain(parameter=aperture.name), "W/m2")
        return replace(self, heat_inputs=(*self.heat_inputs, heat), parameters=(*self.parameters, aperture))

    def with_share(self, channel: str, typical: float) -> Network:
        """A copy in which the heat input `channel` [W] is a meter of several zones, of which this one's share is
        learned and usually `typical`, whatever was thought of it before."""
        known: dict[str, Any] = {"typical": max(typical, _SMALLEST_SHARE), "spread": _SPREAD_OF_SHARES}
        if channel in self.shares:
            return self.with_parameter(SHARE + channel, **known)
        own = [heat for heat in self.heat_inputs if heat.channel == channel]
        if [heat.gain for heat in own] != [Gain(1.0)]:
            raise NetworkError(
                f"network '{self.name}' has gains of '{channel}' of its own, beside which no share of it can be learned"
            )
        share = Parameter(SHARE + channel, "1", _SMALLEST_SHARE, 1.0, **known)
        # As in a table: gains have the order of the heat inputs, after everything else.
        later = {heat.gain.parameter for heat in self.heat_inputs[self.heat_inputs.index(own[0]) :]}
        place = next((at for at, each in enumerate(self.parameters) if each.name in later), len(self.parameters))
        return replace(
            self,
            heat_inputs=tuple(
                replace(heat, gain=Gain(parameter=share.name)) if heat in own else heat for heat in self.heat_inputs
            ),
            parameters=(*self.parameters[:place], share, *self.parameters[place:]),
        )

    def initial_temperature(self, node: str) -> InitialTemperature:
        """The starting rule of `node`: its own, or the first output with .5 K if measured and 3 K if not."""
        return self.initial.get(node, InitialTemperature(MEASURED, 0.5 if node in self.measured else 3.0))

    def validate(self) -> Network:
        """Return this network, or raise NetworkError with one sentence naming the first thing wrong with it."""
        for check in (_check_nodes, _check_parameters, _check_conductances, _check_heat, _check_terms, _check_grounded):
            problem = check(self)
            if problem:
                raise NetworkError(f"network '{self.name}': {problem}")
        return self


_SMALLEST, _LARGEST = 1e-6, 1e13
_WIDEST = 1e9
"""Ratio of conductances up to which G_int stays well away from singular in double precision."""

Problem = str | None


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"


def _duplicate(names: Iterable[str]) -> str | None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


def _check_nodes(network: Network) -> Problem:
    if not network.nodes:
        return "it has no state node; give at least one node a capacitance"
    if not network.boundaries:
        return "it has no boundary node; name at least one prescribed temperature such as T_out"
    twice = _duplicate((*network.nodes, *network.boundaries, *network.heat_channels))
    if twice:
        return f"the name '{twice}' is used for two nodes or channels; every node and heat input needs its own"
    if not network.measured:
        return "no node is measured; list at least one state node in 'measured'"
    for node in network.measured:
        if node not in network.nodes:
            return f"measured node '{node}' is not a state node; the state nodes are {_listed(network.nodes)}"
    twice = _duplicate(network.measured)
    if twice:
        return f"node '{twice}' is listed twice in 'measured'"
    for node, start in network.initial.items():
        if node not in network.nodes:
            return f"initial temperature for '{node}', which is not a state node ({_listed(network.nodes)})"
        if isinstance(start.source, str) and start.source != MEASURED and start.source not in network.boundaries:
            return (
                f"initial temperature of '{node}' comes from '{start.source}'; "
                f"it can be 'measured', a boundary node ({_listed(network.boundaries)}) or a number in degC"
            )
        if not start.sd > 0:
            return f"initial temperature of '{node}' has sd {start.sd}; it must be greater than 0 K"
    return None


def _check_parameters(network: Network) -> Problem:
    twice = _duplicate(parameter.name for parameter in network.parameters)
    if twice:
        return f"parameter '{twice}' is defined twice"
    for parameter in network.parameters:
        at = f"parameter '{parameter.name}'"
        if parameter.free:
            if not 0 < parameter.lower < float("inf"):
                return f"{at} has lower bound {parameter.lower:g}; a log-uniform prior needs a bound above 0"
            if not parameter.lower < parameter.upper < float("inf"):
                return (
                    f"{at} has lower bound {parameter.lower:g} and upper bound {parameter.upper:g}; "
                    "the lower one must be smaller"
                )
            if parameter.lower < _SMALLEST or parameter.upper > _LARGEST:
                return f"{at} has bounds outside {_SMALLEST:g} to {_LARGEST:g} {parameter.unit}; no building needs them"
        elif parameter.nominal is None:
            return f"{at} is not free and has no value; give it a value or bounds"
        if parameter.nominal is not None and not 0 < parameter.nominal < float("inf"):
            return f"{at} has value {parameter.nominal:g}; it must be a positive number"
        if parameter.nominal is not None and not _SMALLEST <= parameter.nominal <= _LARGEST:
            return (
                f"{at} has value {parameter.nominal:g}, outside {_SMALLEST:g} to {_LARGEST:g} {parameter.unit}; "
                "no building needs it"
            )
        typical = parameter.typical if parameter.free else None
        if typical is not None and not parameter.lower <= typical <= parameter.upper:
            return f"{at} has the typical value {typical:g}, outside {parameter.lower:g} to {parameter.upper:g}"
    twice = _duplicate([*network.capacitances.values(), *(edge.name for edge in network.conductances)])
    if twice:
        return f"parameter '{twice}' stands for two elements; every capacitance and conductance needs its own"
    used = set(network.capacitances.values()) | {edge.name for edge in network.conductances}
    used |= {heat.gain.parameter for heat in network.heat_inputs if heat.gain.parameter is not None}
    defined = {parameter.name for parameter in network.parameters}
    for name in sorted(used - defined):
        return f"parameter '{name}' is used but has neither bounds nor a value"
    for name in sorted(defined - used):
        return f"parameter '{name}' is defined but nothing uses it"
    return None


def _check_conductances(network: Network) -> Problem:
    known = (*network.nodes, *network.boundaries)
    pairs: dict[frozenset[str], str] = {}
    reach = [network.parameter(edge.name) for edge in network.conductances]
    if reach:
        lowest = min(p.lower if p.free else p.nominal or 1.0 for p in reach)
        highest = max(p.upper if p.free else p.nominal or 1.0 for p in reach)
        if highest > _WIDEST * lowest:
            return (
                f"its conductances span {lowest:g} to {highest:g} W/K, more than a factor of {_WIDEST:g}; narrow them"
            )
    for edge in network.conductances:
        for node in edge.between:
            if node not in known:
                return f"conductance '{edge.name}' names the unknown node '{node}'; the nodes are {_listed(known)}"
        first, second = edge.between
        if first == second:
            return f"conductance '{edge.name}' connects '{first}' with itself"
        if first in network.boundaries and second in network.boundaries:
            return f"conductance '{edge.name}' connects two boundary nodes, which changes nothing; remove it"
        pair = frozenset(edge.between)
        if pair in pairs:
            return f"conductances '{pairs[pair]}' and '{edge.name}' connect the same two nodes; merge them"
        pairs[pair] = edge.name
    return None


def _check_heat(network: Network) -> Problem:
    seen: set[tuple[str, str]] = set()
    units: dict[str, str] = {}
    gains = {heat.gain.parameter for heat in network.heat_inputs}
    elements = {*network.capacitances.values(), *(edge.name for edge in network.conductances)}
    for name in sorted(gains & elements, key=str):
        return f"parameter '{name}' is both an element of the network and the gain of a heat input"
    for heat in network.heat_inputs:
        if heat.node not in network.nodes:
            return f"heat input '{heat.channel}' enters '{heat.node}', which is not a state node"
        if (heat.channel, heat.node) in seen:
            return f"heat input '{heat.channel}' enters '{heat.node}' twice; merge the two"
        seen.add((heat.channel, heat.node))
        if units.setdefault(heat.channel, heat.unit) != heat.unit:
            return f"heat input '{heat.channel}' is given in {units[heat.channel]} and in {heat.unit}"
    return None


def _check_terms(network: Network) -> Problem:
    twice = _duplicate((*network.inputs, *(term.name for term in network.terms)))
    if twice:
        return f"the name '{twice}' is used for two inputs or terms; every term needs its own"
    for term in network.terms:
        at = f"term '{term.name}'"
        if term.node not in network.nodes:
            return f"{at} heats '{term.node}', which is not a state node; the state nodes are {_listed(network.nodes)}"
        if not term.sd > 0 or not term.walk >= 0:
            return f"{at} has sd {term.sd:g} and walk {term.walk:g}; the one must be above 0, the other at least 0"
        if not abs(term.mean) < float("inf") or (term.lower is not None and term.mean < term.lower):
            return f"{at} has mean {term.mean:g}, which must be a number, and not below its lower bound"
    return None


def _check_grounded(network: Network) -> Problem:
    reached = set(network.boundaries)
    grew = True
    while grew:
        grew = False
        for edge in network.conductances:
            if len(reached.intersection(edge.between)) == 1:
                reached.update(edge.between)
                grew = True
    for node in network.nodes:
        if node not in reached:
            return (
                f"node '{node}' is not tied to any boundary node ({_listed(network.boundaries)}) "
                "by a chain of conductances; add the missing conductance"
            )
    for boundary in network.boundaries:
        if not any(boundary in edge.between for edge in network.conductances):
            return f"boundary node '{boundary}' has no conductance; connect it or remove it"
    return None
