"""A network as a picture: SVG that needs nothing beside itself.

Nodes stand in columns by how many conductances lie between them and the first measured node; boundaries are squares.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import NamedTuple

from estimator.diagnosis.finding import amount
from estimator.network.network import HeatInput, Network

_COLUMN, _ROW, _MARGIN = 270.0, 165.0, 110.0
_RADIUS = 34.0
_RULES = {
    ".edge": "stroke:var(--soft,#5b6776);stroke-width:2;fill:none",
    ".node": "fill:var(--lead,#eef5f9);stroke:var(--accent,#0b5c8a);stroke-width:2",
    ".measured": "fill:var(--node,#cfe5f2);stroke-width:3",
    ".boundary": "fill:var(--code,#f2f5f8);stroke:var(--soft,#5b6776);stroke-width:2",
    ".heat": "stroke:#c2571a;stroke-width:2;fill:none",
    ".tip": "fill:#c2571a",
    "text": "font:13px system-ui,sans-serif;fill:var(--ink,#1b2430);text-anchor:middle",
    ".small": "font-size:11px;fill:var(--soft,#5b6776)",
    ".of-edge": "paint-order:stroke;stroke:var(--paper,#fff);stroke-width:4px",
    ".of-heat": "fill:#c2571a",
}
# A style in an SVG element holds for the whole page, unless it names the element.
_STYLE = "".join(f".network {selector}{{{rule}}}" for selector, rule in _RULES.items())


class _Place(NamedTuple):
    x: float
    y: float


def picture(network: Network, values: Mapping[str, float]) -> str:
    """The SVG of `network`, with the parameters in `values` (name: value in its unit) beside what they belong to."""
    places = _places(network)
    width = max(place.x for place in places.values()) + _MARGIN
    height = max(place.y for place in places.values()) + _MARGIN
    parts = [_edge(network, places, values, *edge.between, name=edge.name) for edge in network.conductances]
    inputs: dict[str, list[HeatInput]] = {}
    for heat in network.heat_inputs:
        inputs.setdefault(heat.node, []).append(heat)
    parts += [_heats(network, places[node], heats, values) for node, heats in inputs.items()]
    parts += [_body(network, name, place, values) for name, place in places.items()]
    title = escape(f"The network {network.name}")
    return (
        f"<svg class='network' xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width:.0f} {height:.0f}' role='img' "
        f"aria-label='{title}' style='max-width:{width:.0f}px;width:100%'><title>{title}</title>"
        f"<style>{_STYLE}</style>{''.join(parts)}</svg>"
    )


def _places(network: Network) -> dict[str, _Place]:
    """Where each node and boundary stands."""
    neighbours: dict[str, list[str]] = {name: [] for name in (*network.nodes, *network.boundaries)}
    for edge in network.conductances:
        one, other = edge.between
        neighbours[one].append(other)
        neighbours[other].append(one)
    column = {network.measured[0]: 0}
    front = [network.measured[0]]
    while front:
        reached = [name for node in front for name in neighbours[node] if name not in column]
        column |= dict.fromkeys(reached, column[front[0]] + 1)
        front = [name for name in dict.fromkeys(reached) if name not in network.boundaries]
    # Boundaries stand at the right edge; whatever no conductance reaches stands with the measured node.
    last = max((column.get(name, 0) for name in network.nodes), default=0) + 1
    column |= dict.fromkeys(network.boundaries, last)
    columns: dict[int, list[str]] = {}
    for name in neighbours:
        columns.setdefault(column.get(name, 0), []).append(name)
    tallest = max(map(len, columns.values()))
    found = {}
    for place, names in columns.items():
        for row, name in enumerate(names):
            y = _MARGIN + _ROW * (row + (tallest - len(names)) / 2.0)
            found[name] = _Place(_MARGIN + _COLUMN * place, y)
    return found


def _edge(
    network: Network, places: Mapping[str, _Place], values: Mapping[str, float], one: str, other: str, *, name: str
) -> str:
    a, b = places[one], places[other]
    length = math.hypot(b.x - a.x, b.y - a.y) or 1.0
    # A straight line over two columns or rows would run through what stands between.
    far = abs(b.x - a.x) > 1.5 * _COLUMN or (a.x == b.x and abs(b.y - a.y) > 1.5 * _ROW)
    bend = 0.9 * _ROW if far else 0.0
    x, y = (a.x + b.x) / 2 + bend * (b.y - a.y) / length, (a.y + b.y) / 2 - bend * (b.x - a.x) / length
    middle = _Place((a.x + b.x) / 4 + x / 2, (a.y + b.y) / 4 + y / 2)
    text = _valued(network, name, values)
    return (
        f"<path class='edge' d='M{a.x:.0f} {a.y:.0f}Q{x:.0f} {y:.0f} {b.x:.0f} {b.y:.0f}'/>"
        f"<text class='of-edge' x='{middle.x:.0f}' y='{middle.y - 6:.0f}'>{text}</text>"
    )


def _heats(network: Network, place: _Place, heats: list[HeatInput], values: Mapping[str, float]) -> str:
    """The heat that enters a node, from above."""
    top = place.y - _RADIUS
    lines = [
        f"<text class='of-heat' x='{place.x:.0f}' y='{top - 36 - 15 * row:.0f}'>"
        f"{escape(heat.channel)}{escape(_gain(network, heat, values))}</text>"
        for row, heat in enumerate(heats)
    ]
    return (
        f"<path class='heat' d='M{place.x:.0f} {top - 30:.0f}V{top - 6:.0f}'/>"
        f"<path class='tip' d='M{place.x - 6:.0f} {top - 10:.0f}h12l-6 9z'/>{''.join(lines)}"
    )


def _gain(network: Network, heat: HeatInput, values: Mapping[str, float]) -> str:
    gain = heat.gain
    if gain.parameter is None:
        return "" if gain.constant == 1.0 else f" × {amount(gain.constant)}"
    if gain.sign < 0:
        return f" × (1 − {gain.parameter})"
    return f" × {gain.parameter}{_value(network, gain.parameter, values)}"


def _body(network: Network, name: str, place: _Place, values: Mapping[str, float]) -> str:
    label = f"<text x='{place.x:.0f}' y='{place.y + 5:.0f}'>{escape(name)}</text>"
    if name in network.boundaries:
        return (
            f"<rect class='boundary' x='{place.x - _RADIUS:.0f}' y='{place.y - 0.6 * _RADIUS:.0f}' "
            f"width='{2 * _RADIUS:.0f}' height='{1.2 * _RADIUS:.0f}' rx='4'/>{label}"
        )
    kind = "node measured" if name in network.measured else "node"
    capacitance = _valued(network, network.capacitances[name], values)
    return (
        f"<circle class='{kind}' cx='{place.x:.0f}' cy='{place.y:.0f}' r='{_RADIUS:.0f}'/>{label}"
        f"<text class='small' x='{place.x:.0f}' y='{place.y + _RADIUS + 16:.0f}'>{capacitance}</text>"
    )


def _valued(network: Network, parameter: str, values: Mapping[str, float]) -> str:
    return escape(f"{parameter}{_value(network, parameter, values)}")


def _value(network: Network, name: str, values: Mapping[str, float]) -> str:
    value = values.get(name, math.nan)
    unit = network.parameter(name).unit
    return f" {amount(value)}{'' if unit == '1' else f' {unit}'}" if math.isfinite(value) else ""
