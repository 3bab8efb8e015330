"""A zone's forecasts held to what came: counted right, kept over restarts and gaps, never in the way."""

import numpy as np
import pytest
from support.thermostat_house import samples as house
from support.zone_samples import PERIOD, fed, sample, worker

from service.records.sample import Sample
from service.zone.worker import ZoneWorker

DAY = 86400 // PERIOD


def stepped(temperatures):
    zone = worker("mkf", "tite", 600, hold_inputs=1200.0, particles=20)
    for k, y in enumerate(temperatures):
        zone.step(Sample.measured(k * zone.period, np.array([y]), np.array([5.0, 600.0 * (k % 5 < 2)])))
    return zone


def lived(steps, zone=None, first=0):
    zone = zone or worker(particles=50)
    return zone, [zone.step(sample(k)) for k in range(first, first + steps)]


def by_lead(zone, days=1):
    return {one.lead: one for one in zone.skill().over(days)}


@pytest.fixture(scope="module")
def day_and_a_half() -> tuple[ZoneWorker, list]:
    return lived(3 * DAY // 2)


def test_every_horizon_is_verified_once_an_hour(day_and_a_half):
    zone, _ = day_and_a_half
    found = by_lead(zone, 7)
    assert set(found) == {PERIOD, 3600, 21600, 86400}
    assert {lead: one.forecasts for lead, one in found.items() if lead > PERIOD} == {3600: 35, 21600: 30, 86400: 12}
    for one in found.values():
        assert 0.0 <= one.coverage <= 1.0
        assert one.crps < one.persistence_rmse + one.rmse


def test_a_gap_ends_what_was_pending_and_keeps_what_was_verified():
    zone, _ = lived(DAY // 2)
    before = by_lead(zone)[3600].forecasts
    zone, _ = lived(6, zone, first=DAY)
    assert by_lead(zone, 7)[3600].forecasts == before, "nothing from before the gap comes true behind it"
    zone, _ = lived(30, zone, first=DAY + 6)
    assert by_lead(zone, 7)[3600].forecasts > before


def test_a_gap_drops_what_was_pending_of_a_thermostat_and_keeps_what_was_proved():
    data = list(house(4, 1800))
    zone = fed(worker("ekf", "tite", 1800), data[: 3 * 48])
    proved = zone.carried.live.members
    zone.step(data[3 * 48 + 20])
    assert len(zone.carried.live.issues) <= 1
    assert proved.hours.max() > 0.0
    assert zone.carried.live.members.excess.tobytes() == proved.excess.tobytes()


def test_the_reference_follows_a_sensor_that_was_moved_and_not_one_wrong_reading():
    level = 20.0 + 0.1 * np.sin(np.arange(300) / 9)
    moved = stepped(np.where(np.arange(300) < 200, level, level - 25.0))
    assert abs(moved.carried.standing.verified.arx.outputs[0, 0] - (level[-1] - 25.0)) < 1.0
    wrong = level.copy()
    wrong[290] = -10.0
    once = stepped(wrong[:292])
    assert abs(once.carried.standing.verified.arx.outputs[0, 0] - level[291]) < 1.0
    assert (once.carried.standing.verified.arx.seen > 15.0).all()
