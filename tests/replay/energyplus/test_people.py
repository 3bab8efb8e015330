"""Days are drawn anew from the seed, and any day can be asked for alone."""

import numpy as np
import pytest

from replay.energyplus.buildings import BUILDINGS
from replay.energyplus.heating import Planned, heating_named
from replay.energyplus.people import draw_day
from replay.localtime import DAY

MONDAY = 20101  # days since 1970


@pytest.mark.parametrize("name", BUILDINGS)
def test_a_day_follows_from_its_number_and_the_seed_alone(name: str) -> None:
    for number, room in enumerate(BUILDINGS[name].rooms):
        days = [draw_day(room.use, MONDAY + k, 300.0, 1, number) for k in range(14)]
        for field, values in zip(draw_day(room.use, MONDAY + 9, 300.0, 1, number), days[9], strict=True):
            np.testing.assert_array_equal(field, values)
        other = [draw_day(room.use, MONDAY + k, 300.0, 2, number) for k in range(14)]
        for kind in range(4):
            assert any((one[kind] != two[kind]).any() for one, two in zip(days, other, strict=True))
            assert any((one[kind] != days[0][kind]).any() for one in days[1:])
            assert all(day[kind].shape == (288,) and (day[kind] >= 0).all() for day in days)
        assert all((day.people == np.round(day.people)).all() for day in days)


def test_on_off_heating_has_a_hysteresis() -> None:
    heat = heating_named("on-off", BUILDINGS["timber"], 1)
    rated = BUILDINGS["timber"].rooms[0].heater
    powers = [heat(0.0, np.array([air]), np.array([20.0]))[0] for air in (20.0, 19.6, 20.0, 20.2, 20.4, 20.0, 19.8)]
    assert powers == [0.0, rated, rated, rated, 0.0, 0.0, 0.0]


def test_the_plan_does_not_look_at_the_room_unless_it_becomes_unbearable() -> None:
    plan = Planned(np.array([4000.0, 3000.0]), 1)
    times = MONDAY * DAY + np.arange(0, 21 * DAY, 1800.0)
    cool, warm = (
        np.array([plan(t, np.full(2, air), np.full(2, set_point)) for t in times])
        for air, set_point in ((16.0, 25.0), (24.0, 15.0))
    )
    np.testing.assert_array_equal(cool, warm)
    on = cool > 0
    assert np.all(np.abs(on.mean(axis=0) - 0.5) < 0.02)
    assert abs(np.corrcoef(on.T)[0, 1]) < 0.1, "rooms are heated independently"
    assert (plan(times[0], np.full(2, 14.0), np.zeros(2)) > 0).all()
    assert (plan(times[0], np.full(2, 27.0), np.zeros(2)) == 0).all()
