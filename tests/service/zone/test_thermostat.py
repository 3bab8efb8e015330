"""What a zone learns of its thermostat from its samples."""

import numpy as np
from support.thermostat_house import recorded

from estimator.network.presets import network
from estimator.registry import build
from service.records.sample import Sample
from service.zone import snapshot
from service.zone.worker import WorkerSettings, ZoneWorker

PERIOD = 1800
DAILY = 48


def worker():
    net = network("tite")
    return ZoneWorker(build("ekf", net, PERIOD, {}), WorkerSettings(5, (0.95,), 3, 900.0))


def samples(days, told=True):
    for k, (outputs, inputs, setpoint) in enumerate(zip(*recorded(days, PERIOD), strict=True)):
        yield Sample.measured(k * PERIOD, outputs, inputs)._replace(setpoint=setpoint if told else np.nan)


def fed(zone, some):
    for each in some:
        zone.step(each)
    return zone


def test_a_zone_learns_the_law_of_its_thermostat():
    zone = fed(worker(), samples(4))
    law = zone.carried.thermostat.laws
    assert abs(law.numbers[0, 0] - 6000.0) < 300.0
    assert zone.carried.live.members.hours.max() > 0.0


def test_a_zone_without_a_set_point_remembers_no_fortnight_of_a_thermostat():
    zone = fed(worker(), samples(1, told=False))
    assert len(zone.carried.thermostat.memory.times) == 0
    assert zone.carried.live.issues == ()
    stored = snapshot.take(zone, "mark", "ekf").arrays
    assert sum(rows.nbytes for name, rows in stored.items() if name.startswith(("thermostat.", "live."))) < 10_000


def test_a_gap_drops_what_was_pending_and_keeps_what_was_proved():
    data = list(samples(4))
    zone = fed(worker(), data[: 3 * DAILY])
    proved = zone.carried.live.members
    fed(zone, data[3 * DAILY + 20 : 3 * DAILY + 21])
    assert len(zone.carried.live.issues) <= 1
    assert zone.carried.live.members.excess.tobytes() == proved.excess.tobytes()
