"""The sun against positions by NREL's algorithm (SPA), and the split of the irradiance against its formulas."""

from datetime import datetime

import numpy as np
from support.tables import tabled

from estimator.heat.sun import Location, Sun, diffuse_fraction, geometry, split, sun


@tabled
def test_the_sun_is_where_the_almanac_has_it(time, latitude, longitude, elevation, azimuth):
    """Elevation and azimuth from north by pvlib 0.16.1, `nrel_numpy`, without refraction."""
    found = sun(np.array(datetime.fromisoformat(time).timestamp()), Location(latitude, longitude))
    height, bearing = np.radians([elevation, azimuth])
    expected = np.cos(height) * np.sin(bearing), np.cos(height) * np.cos(bearing), np.sin(height)
    # A hundredth of a degree, and what three decimals of the table leave open.
    np.testing.assert_allclose([found.east, found.north, found.up], expected, atol=2e-4)
    assert 1316 < found.beyond < 1409


def test_a_clear_sky_is_beam_and_a_dark_one_diffuse():
    np.testing.assert_allclose(
        diffuse_fraction(np.array([0.0, 0.22, 0.5, 0.9])), [1.0, 0.9802, 0.65915, 0.165], atol=1e-4
    )
    # The pieces of the correlation meet.
    edges = diffuse_fraction(np.array([0.2199999, 0.2200001, 0.7999999, 0.8000001]))
    assert np.abs(np.diff(edges)[[0, 2]]).max() < 2e-3


def test_beam_falls_on_the_planes_that_the_sun_sees():
    # Half-way up in the south-east: as much on the ground as on a plane that faced it, times the sine of 30 degrees.
    height, bearing = np.radians([30.0, 135.0])
    at = Sun(*(np.array([[part]]) for part in (
        np.cos(height) * np.sin(bearing), np.cos(height) * np.cos(bearing), np.sin(height), 1361.0
    )))  # fmt: skip
    light = split(geometry(at), np.array([400.0]))
    normal = (400.0 - light.diffuse) / np.sin(height)
    share = np.cos(height) * np.sqrt(0.5)
    np.testing.assert_allclose(light.beam, normal[:, None] * [share, share, 0.0, 0.0], atol=1e-9)


def test_nothing_shines_at_night_and_a_low_sun_does_not_dazzle():
    place = Location(47.87, 11.73)
    times = datetime.fromisoformat("2014-01-29T00:00:00+00:00").timestamp() + 600.0 * np.arange(144)
    light = split(geometry(Sun(*(part[:, None] for part in sun(times, place)))), np.full(144, 50.0))
    dark = sun(times, place).up <= 0.0
    assert dark.sum() > 70
    assert (light.beam[dark] == 0.0).all()
    assert (light.beam <= 1420.0).all()
    np.testing.assert_array_equal(light.diffuse[dark], 50.0)
