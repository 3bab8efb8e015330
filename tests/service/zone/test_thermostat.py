"""What a zone learns of its thermostat from its samples."""

from support.thermostat_house import samples
from support.zone_samples import worker

from service.zone import snapshot

PERIOD = 1800
DAILY = 48


def fed(some, zone=None):
    zone = zone or worker("ekf", "tite", PERIOD)
    for each in some:
        zone.step(each)
    return zone


def test_a_zone_learns_the_law_of_its_thermostat():
    zone = fed(samples(4, PERIOD))
    law = zone.carried.thermostat.laws
    assert abs(law.numbers[0, 0] - 6000.0) < 300.0
    assert zone.carried.live.members.hours.max() > 0.0


def test_a_zone_without_a_set_point_remembers_no_fortnight_of_a_thermostat():
    zone = fed(samples(1, PERIOD, told=False))
    assert len(zone.carried.thermostat.memory.times) == 0
    assert zone.carried.live.issues == ()
    stored = snapshot.take(zone, "mark", "ekf").arrays
    assert sum(rows.nbytes for name, rows in stored.items() if name.startswith(("thermostat.", "live."))) < 10_000


def test_a_gap_drops_what_was_pending_and_keeps_what_was_proved():
    data = list(samples(4, PERIOD))
    zone = fed(data[: 3 * DAILY])
    proved = zone.carried.live.members
    fed(data[3 * DAILY + 20 : 3 * DAILY + 21], zone)
    assert len(zone.carried.live.issues) <= 1
    assert zone.carried.live.members.excess.tobytes() == proved.excess.tobytes()
