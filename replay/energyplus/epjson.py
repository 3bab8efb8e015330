"""A `Building` as EnergyPlus reads it (epJSON); `model.toml` has what all models share. There is no HVAC system, and
the system's step is the zone's, so that what is set at its beginning acts during the whole of it."""

import tomllib
from collections.abc import Sequence
from datetime import date
from importlib.resources import files
from typing import Any

from replay.energyplus.buildings import OPPOSITE, PARTS, SIDES, Building, Construction, Room, Side

STEP = 300.0
"""Seconds of a step."""
_YEARS = 20
_ALWAYS = "always"

Model = dict[str, dict[str, dict[str, Any]]]


def part(room: str, what: str) -> str:
    """The name in the model of what the plant drives in a room: its "heater", "people", "lights" and so on."""
    return f"{room} {what}"


def surface(room: str, side: Side) -> str:
    return f"{room} {side}"


def model_of(building: Building, begin: date) -> Model:
    """The model of `building` from the midnight that begins the day `begin` on, for twenty years."""
    shared = tomllib.loads(files(__package__).joinpath("model.toml").read_text(encoding="utf-8"))
    model: Model = shared["base"] | {
        "Building": {building.name: shared["building"]},
        "Timestep": {"step": {"number_of_timesteps_per_hour": round(3600 / STEP)}},
        "ConvergenceLimits": {"limits": {"minimum_system_timestep": round(STEP / 60)}},
        "WindowMaterial:SimpleGlazingSystem": {
            "glazing": {
                "u_factor": building.glazing.u_value,
                "solar_heat_gain_coefficient": building.glazing.solar_heat_gain,
            }
        },
        **{kind: {} for kind in ("Material", "Zone", "BuildingSurface:Detailed", "FenestrationSurface:Detailed")},
        "ZoneCrossMixing": {},
    }
    model["RunPeriod"]["period"] |= {
        "begin_year": begin.year,
        "begin_month": begin.month,
        "begin_day_of_month": begin.day,
        "end_year": begin.year + _YEARS,
    }
    for name in PARTS:
        _add_construction(model, name, getattr(building, name))
    for room in building.rooms:
        model["Zone"][room.name] = {"volume": room.volume}
        for side in SIDES:
            _add_side(model, room, side)
        _add_doors(model, room, building.doors)
        for kind, objects in shared["loads"].items():
            for name, fields in objects.items():
                zone = {"zone_or_zonelist_or_space_or_spacelist_name": room.name}
                model.setdefault(kind, {})[name.format(room.name)] = zone | fields
        joints = model["ZoneInfiltration:DesignFlowRate"][part(room.name, "joints")]
        joints["air_changes_per_hour"] = building.air_changes / _BLAST_AT_DESIGN
    return {kind: objects for kind, objects in model.items() if objects}


_BLAST_AT_DESIGN = 0.606 + 20.0 * 0.03636 + 3.4 * 0.1177
"""What the coefficients of the joints come to at 20 K and 3.4 m/s."""


def _add_construction(model: Model, name: str, layers: Construction) -> None:
    """Construction `name`, and its mirror image for the neighbour's side of it."""
    names = []
    for material, thickness in layers:
        layer = f"{material.name} {1000 * thickness:g} mm"
        names.append(layer)
        model["Material"][layer] = {
            "roughness": "MediumRough",
            "thickness": thickness,
            "conductivity": material.conductivity,
            "density": material.density,
            "specific_heat": material.specific_heat,
        }
    for key, ordered in ((name, names), (f"{name} reversed", names[::-1])):
        fields = ("outside_layer", *(f"layer_{number}" for number in range(2, len(ordered) + 1)))
        model["Construction"][key] = dict(zip(fields, ordered, strict=True))


def _add_side(model: Model, room: Room, side: Side) -> None:
    """One side of the box. Its floor lies over a ventilated crawl space, so that all heat goes to the outdoor air."""
    kind = {"floor": "Floor", "ceiling": "Roof"}.get(side, "Wall")
    construction = {"floor": "ground", "ceiling": "roof"}.get(side, "wall")
    fields: dict[str, Any] = {"outside_boundary_condition": "Outdoors"}
    if side == "floor":
        fields |= {"sun_exposure": "NoSun", "wind_exposure": "NoWind"}
    if side in room.beside:
        kind = "Ceiling" if side == "ceiling" else kind
        # The layers are listed once, and the other room sees them in the reverse order.
        mirrored = side in ("ceiling", "west", "north")
        construction = "storey" if side in ("floor", "ceiling") else "partition"
        construction += " reversed" if mirrored else ""
        fields = {
            "outside_boundary_condition": "Surface",
            "outside_boundary_condition_object": surface(room.beside[side], OPPOSITE[side]),
            "sun_exposure": "NoSun",
            "wind_exposure": "NoWind",
        }
    corners = _corners(room, side)
    model["BuildingSurface:Detailed"][surface(room.name, side)] = fields | {
        "surface_type": kind,
        "construction_name": construction,
        "zone_name": room.name,
        "vertices": [
            {f"vertex_{axis}_coordinate": value for axis, value in zip("xyz", corner, strict=True)}
            for corner in corners
        ],
    }
    if side in room.windows:
        _add_window(model, surface(room.name, side), corners, room.windows[side])


def _corners(room: Room, side: Side) -> list[tuple[float, float, float]]:
    """The four corners of a side, counterclockwise from the upper left as seen from outside."""
    (x, y, z), (dx, dy, dz) = room.corner, room.size
    base, top = z, z + dz
    # Left and right are as seen from outside.
    feet = {
        "south": ((x, y), (x + dx, y)),
        "east": ((x + dx, y), (x + dx, y + dy)),
        "north": ((x + dx, y + dy), (x, y + dy)),
        "west": ((x, y + dy), (x, y)),
    }
    if side in feet:
        left, right = feet[side]
        return [(*left, top), (*left, base), (*right, base), (*right, top)]
    if side == "ceiling":
        return [(x, y + dy, top), (x, y, top), (x + dx, y, top), (x + dx, y + dy, top)]
    return [(x, y, base), (x, y + dy, base), (x + dx, y + dy, base), (x + dx, y, base)]


def _add_window(model: Model, wall: str, corners: Sequence[tuple[float, float, float]], area: float) -> None:
    """A window of `area` m2 in the middle of a wall, of the wall's proportions."""
    centre = [sum(values) / 4 for values in zip(*corners, strict=True)]
    whole = _distance(corners[0], corners[1]) * _distance(corners[1], corners[2])
    shrink = (area / whole) ** 0.5
    fields: dict[str, Any] = {
        "surface_type": "Window",
        "construction_name": "window",
        "building_surface_name": wall,
        "number_of_vertices": 4,
    }
    for number, corner in enumerate(corners, start=1):
        for axis, middle, value in zip("xyz", centre, corner, strict=True):
            fields[f"vertex_{number}_{axis}_coordinate"] = middle + shrink * (value - middle)
    model["FenestrationSurface:Detailed"][f"{wall} window"] = fields


def _distance(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    return float(sum((left - right) ** 2 for left, right in zip(a, b, strict=True)) ** 0.5)


def _add_doors(model: Model, room: Room, flow: float) -> None:
    """Air that neighbours exchange; each pair once, as the exchange goes both ways."""
    for other in room.beside.values():
        if flow > 0.0 and room.name < other:
            model["ZoneCrossMixing"][f"{room.name} {other} door"] = {
                "zone_or_space_name": room.name,
                "source_zone_or_space_name": other,
                "schedule_name": _ALWAYS,
                "design_flow_rate": flow,
            }
