"""Walls, floors and roofs as layers of material, and windows as a pane with two numbers."""

from __future__ import annotations

from typing import NamedTuple


class Material(NamedTuple):
    """Conductivity [W/(m K)], density [kg/m3] and specific heat [J/(kg K)]."""

    name: str
    conductivity: float
    density: float
    specific_heat: float


class Layer(NamedTuple):
    """A material, `thickness` m of it."""

    material: Material
    thickness: float


Construction = tuple[Layer, ...]
"""Layers from the outside in."""


class Glazing(NamedTuple):
    """A window by its U-value [W/(m2 K)] and the share of the sun that it lets in as heat."""

    u_value: float
    solar_heat_gain: float


CONCRETE = Material("concrete", 1.4, 2100.0, 1000.0)
BLOCK = Material("concrete block", 0.51, 1400.0, 1000.0)
BRICK = Material("brick", 0.75, 1700.0, 900.0)
SCREED = Material("screed", 1.2, 2000.0, 1000.0)
FOAM = Material("foam insulation", 0.04, 20.0, 1400.0)
FIBRE = Material("wood fibre insulation", 0.04, 50.0, 2000.0)
TIMBER = Material("timber", 0.14, 530.0, 1600.0)
PLASTERBOARD = Material("plasterboard", 0.21, 900.0, 1000.0)
TILES = Material("roof tiles", 0.9, 1900.0, 900.0)
