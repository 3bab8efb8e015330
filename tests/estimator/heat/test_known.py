"""Drive rows: hats that add up to one, the sun of the facades, and the measured inputs untouched."""

from dataclasses import replace

import numpy as np
import pytest
from support.tables import tabled

from estimator.errors import NetworkError
from estimator.heat.known import KnownHeat, LocalTime
from estimator.heat.sun import Location, clear_sky, sun
from estimator.heat.terms import HABIT_HOURS, SUN_HOURS, with_known_heat
from estimator.network.network import HeatInput
from estimator.network.presets import automatic

PLACE = Location(47.87, 11.73)
ROOM = automatic(["T_i", "T_out", "u_heat", "I_sol"])
JUNE = 1371513600.0
"""18 June 2013, a Tuesday, 00:00 UTC."""


def calendar(times):
    """UTC everywhere, and every third day off."""
    hour = times / 3600.0 % 24.0
    return LocalTime(hour, (hour - 1.0) % 24.0, (times // 86400 % 3 == 0).astype(float))


def rows(net, period=600.0, days=3):
    times = JUNE + period * np.arange(days * 86400 // period)
    light = 900.0 * np.maximum(sun(times + period / 2, PLACE).up, 0.0)
    inputs = np.column_stack([np.full(len(times), 10.0), np.full(len(times), 500.0), light])
    assert net.inputs == ("T_out", "u_heat", "I_sol")
    return times, inputs, KnownHeat(net, period, calendar, PLACE).drive(times, inputs)


def of(net, drive, name):
    return drive[:, net.drive.index(name)]


def test_without_terms_the_drive_is_the_inputs():
    times, inputs, drive = rows(ROOM)
    assert drive is inputs
    first = inputs[:1]
    assert KnownHeat(ROOM, 600.0, calendar).drive(times[:1], first) is first


def test_habits_are_hats_of_the_local_hour_that_add_up_to_one():
    net = with_known_heat(ROOM, habits=True)
    assert len(net.terms) == 16
    times, inputs, drive = rows(net)
    np.testing.assert_array_equal(drive[:, :3], inputs)
    usual = np.array([of(net, drive, f"habit_{hour:02}") for hour in HABIT_HOURS])
    extra = np.array([of(net, drive, f"habit_weekend_{hour:02}") for hour in HABIT_HOURS])
    np.testing.assert_allclose(usual.sum(axis=0), 1.0)
    np.testing.assert_allclose(extra.sum(axis=0), calendar(times + 300.0).off)
    # The middle of the interval from 5:50 to 6:00 is a 36th of three hours before the peak at 6.
    at = 5 * 6 + 5
    assert usual[2, at] == pytest.approx(1.0 - 1.0 / 36.0)
    assert usual[1, at] == pytest.approx(1.0 / 36.0)


def test_one_row_is_the_row_of_many():
    net = with_known_heat(ROOM, habits=True, sun="facades", location=PLACE)
    times, inputs, drive = rows(net)
    known = KnownHeat(net, 600.0, calendar, PLACE)
    for k in (0, 50, 200):
        np.testing.assert_array_equal(known.drive(times[k : k + 1], inputs[k : k + 1])[0], drive[k])
    np.testing.assert_array_equal(known.drive(times[::-5], inputs[::-5]), drive[::-5])
    assert len(known.drive(times[:0], inputs[:0])) == 0
    # Beside the grid of the period it is nearly the same.
    assert (np.abs(known.drive(times + 1.0, inputs) - drive) <= 0.01 * drive.max(axis=0)).all()


@pytest.mark.parametrize(("period", "days", "apart", "computed"), [(600.0, 1, 3600.0, 144), (600.0, 30, 3600.0, 720),
                                                                  (10.0, 1, 3600.0, 24)])  # fmt: skip
def test_no_more_is_computed_than_a_day_of_long_periods(period, days, apart, computed):
    sizes = []

    def counted(times):
        sizes.append(times.size)
        return calendar(times)

    known = KnownHeat(with_known_heat(ROOM, habits=True), period, counted, PLACE)
    times = JUNE + apart * np.arange(days * 86400 // apart)
    for _ in range(2):
        known.drive(times, np.ones((len(times), 3)))
    assert set(sizes) == {computed}


def test_the_sun_goes_from_east_to_west():
    net = with_known_heat(ROOM, sun="facades", location=PLACE)
    assert [term.name for term in net.terms] == ["sun_east", "sun_south", "sun_west", "sun_diffuse", "sun_envelope"]
    assert net.terms[-1].node == "T_e"
    _, inputs, drive = rows(net, days=1)
    peaks = [of(net, drive, f"sun_{face}").argmax() * 600.0 / 3600.0 for face in ("east", "south", "west")]
    # Noon is at 11:15 UTC there.
    assert peaks[0] < 9 < peaks[1] < 13.5 < peaks[2]
    np.testing.assert_array_equal(of(net, drive, "sun_envelope"), inputs[:, 2])


def test_in_the_south_the_sun_stands_in_the_north():
    net = with_known_heat(ROOM, sun="facades", location=Location(-33.9, 18.4))
    assert [term.name for term in net.terms][:3] == ["sun_east", "sun_north", "sun_west"]


def test_the_sun_by_the_hour_is_the_irradiance_shared_out():
    net = with_known_heat(ROOM, sun="hours")
    _, inputs, drive = rows(net, days=1)
    shares = np.array([of(net, drive, f"sun_{hour:02}") for hour in SUN_HOURS])
    np.testing.assert_allclose(shares.sum(axis=0), inputs[:, 2])
    # Standard time is an hour behind the clock here: the first hat goes on until seven, the third begins at ten.
    np.testing.assert_array_equal(shares[0][: 7 * 6], inputs[: 7 * 6, 2])
    assert (shares[2][10 * 6 : 16 * 6] > 0.0).all()
    assert (shares[2][: 10 * 6] == 0.0).all()


def test_a_long_interval_holds_the_mean_of_the_short_ones():
    net = with_known_heat(ROOM, sun="facades", location=PLACE)
    times, inputs, fine = rows(net, days=1)
    coarse = KnownHeat(net, 3600.0, calendar, PLACE).drive(times[::6], inputs.reshape(24, 6, 3).mean(axis=1))
    for face in ("east", "south", "west"):
        means = of(net, fine, f"sun_{face}").reshape(24, 6).mean(axis=1)
        # The split is not linear, and bent in the hours of sunrise and sunset.
        day = of(net, coarse, "sun_envelope") > 100.0
        np.testing.assert_allclose(of(net, coarse, f"sun_{face}")[day], means[day], atol=0.05 * means.max())


@pytest.mark.parametrize("cover", [None, np.linspace(-10.0, 110.0, 144)])
def test_under_a_clear_sky_or_known_clouds_a_zone_without_a_sensor_knows_what_one_would_measure(cover):
    times = JUNE + 600.0 * np.arange(144)
    sensed = with_known_heat(ROOM, sun="facades", location=PLACE)
    inputs, left = np.column_stack([np.full(144, 10.0), np.full(144, 500.0)]), np.ones(144)
    channels, told = ["T_i", "T_out", "u_heat"], inputs
    if cover is not None:
        channels, told = [*channels, "cloud_cover"], np.column_stack([inputs, cover])
        left = 1.0 - 0.75 * np.clip(cover / 100.0, 0.0, 1.0) ** 3.4
    clear = with_known_heat(automatic(channels), sun="clear-sky", location=PLACE)
    found = KnownHeat(clear, 600.0, calendar, PLACE).drive(times, told)
    measured = np.column_stack([inputs, left * clear_sky(sun(times[:, None] + 300.0, PLACE))])
    known = KnownHeat(sensed, 600.0, calendar, PLACE).drive(times, measured)
    assert {term.name for term in clear.terms} == {term.name for term in sensed.terms}
    for term in clear.terms:
        tolerance = 25.0 if term.name == "sun_envelope" else 1e-9
        np.testing.assert_allclose(of(clear, found, term.name), of(sensed, known, term.name), atol=tolerance)
    assert 900.0 < (of(clear, found, "sun_envelope") / left).max() < 1000.0


def test_priors_grow_with_the_floor_area():
    small, large = (with_known_heat(ROOM, habits=True, sun="hours", floor_area=area) for area in (35.0, 140.0))
    for one, other in zip(small.terms, large.terms, strict=True):
        assert (4 * one.mean, 4 * one.sd, 4 * one.walk) == pytest.approx((other.mean, other.sd, other.walk))


def test_every_measured_room_has_its_own():
    net = with_known_heat(replace(ROOM, measured=("T_i", "T_h")), habits=True)
    assert len(net.terms) == 32
    assert {term.node for term in net.terms} == {"T_i", "T_h"}


@tabled
def test_what_is_missing_is_said(sun, measured, sentence):
    dark = replace(ROOM, heat_inputs=(HeatInput("u_heat", "T_h"),))
    with pytest.raises(NetworkError, match=sentence):
        with_known_heat(ROOM if measured else dark, sun=sun)
