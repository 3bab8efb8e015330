"""Position of the sun, and what a horizontal irradiance means for planes that face one way.

Position: Michalsky, "The Astronomical Almanac's algorithm for approximate solar position", Solar Energy 40 (1988),
within .01 degrees to 2050. Split of the irradiance into diffuse and beam: Erbs, Klein and Duffie, "Estimation of the
diffuse radiation fraction", Solar Energy 28 (1982). Clear sky: Haurwitz, "Insolation in relation to cloudiness and
cloud density", Journal of Meteorology 2 (1945), 1098 W/m2 sin(h) exp(-.057 / sin(h)). Clouds: Kasten and Czeplak,
"Solar and terrestrial radiation dependent on the amount and type of cloud", Solar Energy 24 (1980).
"""

from typing import NamedTuple

import numpy as np

from estimator.arrays import DAY, Array

SOLAR_CONSTANT = 1361.0
"""W/m2."""

_J2000 = 946728000.0
"""UTC s of 1 January 2000, 12 h."""

_LOWEST = 0.065
"""Sine of the elevation (3.7 degrees) below which a horizontal sensor says little of the beam."""

FACES = ("east", "south", "west", "north")


class Location(NamedTuple):
    """Where a building stands, in degrees; north and east are positive."""

    latitude: float
    longitude: float


class Sun(NamedTuple):
    """Direction of the sun at L times, as a unit vector, and the irradiance outside the atmosphere."""

    east: Array
    north: Array
    up: Array
    beyond: Array
    """(L,) in W/m2, on a plane that faces the sun."""


class Irradiance(NamedTuple):
    """Means over L intervals in W/m2."""

    diffuse: Array
    """(L,): on a horizontal plane."""
    beam: Array
    """(L, 4): on vertical planes, by FACES."""


def sun(times: Array, location: Location) -> Sun:
    """The sun at `times` [UTC s], of any shape."""
    days = (times - _J2000) / DAY
    mean_longitude = np.radians((280.460 + 0.9856474 * days) % 360.0)
    anomaly = np.radians((357.528 + 0.9856003 * days) % 360.0)
    longitude = mean_longitude + np.radians(1.915 * np.sin(anomaly) + 0.020 * np.sin(2.0 * anomaly))
    obliquity = np.radians(23.439 - 4e-7 * days)
    ascension = np.arctan2(np.cos(obliquity) * np.sin(longitude), np.cos(longitude))
    declination = np.arcsin(np.sin(obliquity) * np.sin(longitude))
    sidereal = 6.697375 + 0.0657098242 * days + (times / 3600.0) % 24.0
    hour = np.radians(15.0 * sidereal + location.longitude) - ascension
    latitude = np.radians(location.latitude)
    across = np.cos(declination) * np.cos(hour)
    distance = 1.00014 - 0.01671 * np.cos(anomaly) - 0.00014 * np.cos(2.0 * anomaly)
    return Sun(
        east=-np.cos(declination) * np.sin(hour),
        north=np.cos(latitude) * np.sin(declination) - np.sin(latitude) * across,
        up=np.sin(latitude) * np.sin(declination) + np.cos(latitude) * across,
        beyond=SOLAR_CONSTANT / distance**2,
    )


def clear_sky(position: Sun) -> Array:
    """Mean horizontal irradiance (L,) [W/m2] under a clear sky, of L intervals in which the sun is known at S times
    each (L, S)."""
    height = np.maximum(position.up, 1e-3)
    return np.where(position.up > 0.0, 1098.0 * height * np.exp(-0.057 / height), 0.0).mean(axis=1)


def through_clouds(cover: Array) -> Array:
    """Share of the horizontal irradiance of a clear sky that is left under a cloud `cover` [%], of any shape; what is
    beyond 0 to 100 % counts as that."""
    return np.asarray(1.0 - 0.75 * np.clip(cover / 100.0, 0.0, 1.0) ** 3.4)


def diffuse_fraction(clearness: Array) -> Array:
    """Share of the horizontal irradiance that is diffuse, by the clearness index: equation (1) of Erbs et al."""
    k = clearness
    middle = 0.9511 - 0.1604 * k + 4.388 * k**2 - 16.638 * k**3 + 12.336 * k**4
    return np.where(k <= 0.22, 1.0 - 0.09 * k, np.where(k <= 0.8, middle, 0.165))


class Geometry(NamedTuple):
    """What of the sun's way over L intervals decides how its light falls on planes."""

    height: Array
    """(L,): mean sine of the elevation, of which a horizontal sensor says something."""
    outside: Array
    """(L,): mean horizontal irradiance outside the atmosphere [W/m2]; 1 at night."""
    beyond: Array
    """(L,): irradiance there on a plane that faces the sun [W/m2]."""
    towards: Array
    """(L, 4): mean share of the beam that falls on vertical planes, by FACES."""


def geometry(position: Sun) -> Geometry:
    """The means over L intervals in which the sun is known at S times each (L, S)."""
    height = np.where(position.up > 0.0, np.maximum(position.up, _LOWEST), 0.0)
    mean_height = height.mean(axis=1)
    shining = position.up > 0.0
    faces = (position.east, -position.north, -position.east, position.north)
    return Geometry(
        height=mean_height,
        outside=np.where(mean_height > 0.0, (position.beyond * height).mean(axis=1), 1.0),
        beyond=position.beyond[:, 0],
        towards=np.column_stack([np.where(shining, np.maximum(part, 0.0), 0.0).mean(axis=1) for part in faces]),
    )


def split(over: Geometry, horizontal: Array) -> Irradiance:
    """Mean irradiances of L intervals from the measured mean `horizontal` (L,) [W/m2].

    The beam is taken to be constant over the interval while the sun is up.
    """
    horizontal, day = np.maximum(horizontal, 0.0), over.height > 0.0
    fraction = np.where(day, diffuse_fraction(np.minimum(horizontal / over.outside, 1.0)), 1.0)
    normal = np.where(day, (1.0 - fraction) * horizontal / np.where(day, over.height, 1.0), 0.0)
    normal = np.minimum(normal, over.beyond)
    return Irradiance(fraction * horizontal, normal[:, None] * over.towards)
