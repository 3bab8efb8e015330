"""Live zones go by the wall clock: intervals close without readings, clocks that are set, and what is said of it."""

import asyncio
import logging

import pytest
from support.running_zone import alone
from support.tables import tabled

import service.daemon.supply.feeding
from adapters.reading import Fault, Quality, Reading
from service.daemon.supply.feeding import keep_time, watch_clock
from service.zone.alignment import Alignment
from service.zone.clock import Clock
from service.zone.health import state_and_reason
from service.zone.worker import Progress


@tabled
def test_the_state_of_a_zone_says_what_is_known(progress, known, state, reason):
    facts = {"has_forecast": True, "failure": None, "trouble": (), "live": False, "ended": False, "now": 2e9} | known
    assert state_and_reason(Progress(**progress), **facts) == (state, reason)


class SetClock:
    """A wall clock and a steady one that tests set; sleeping moves both."""

    def __init__(self, monkeypatch, *, steps):
        self.now, self.beside, self.steps, self.jumps = 1000.0, 50.0, steps, {}
        self.clock = Clock(lambda: self.now, lambda: self.beside)
        monkeypatch.setattr(service.daemon.supply.feeding.asyncio, "sleep", self.sleep)

    async def sleep(self, seconds):
        if self.steps == 0:
            raise asyncio.CancelledError
        self.steps -= 1
        self.now += seconds + self.jumps.pop(self.steps, 0.0)
        self.beside += seconds


class Noting:
    def __init__(self, id, due=True):
        self.id, self.due, self.asked = id, due, 0

    @property
    def intake(self):
        return self

    def is_due(self):
        return self.due

    async def keep_time(self):
        self.asked += 1
        if self.asked == 2:
            raise OSError("disk full")


def run(coroutine):
    with pytest.raises(asyncio.CancelledError):
        asyncio.run(coroutine)


def test_every_live_zone_is_told_the_time_and_a_failure_does_not_stop_it(monkeypatch, caplog):
    SetClock(monkeypatch, steps=4)
    names = [f"z{k}" for k in range(2 * service.daemon.supply.feeding.TOGETHER + 1)]
    zones = {name: Noting(name) for name in names} | {"r": Noting("r", due=False)}
    run(keep_time(zones))
    assert {zone.asked for name, zone in zones.items() if name != "r"} == {4}
    assert zones["r"].asked == 0
    assert "zone 'z0' cannot close its interval: OSError('disk full')" in caplog.text


@pytest.mark.parametrize(("jump", "said"), [(3600.0, "+3600.0 s"), (-90.0, "-90.0 s"), (1.0, None)])
def test_a_wall_clock_that_is_set_is_said_once(monkeypatch, caplog, jump, said):
    clock = SetClock(monkeypatch, steps=10)
    clock.jumps = {5: jump}
    with caplog.at_level(logging.WARNING):
        run(watch_clock(clock.clock))
    assert [record.args[0] for record in caplog.records] == ([] if said is None else [pytest.approx(jump)])
    assert said is None or said in caplog.text


async def test_a_live_zone_names_what_its_device_refuses_until_it_gives_it(tmp_path):
    async with alone(tmp_path) as (zone, shared):
        await zone.prepare()
        network = zone.network
        zone.align(Alignment(network, zone.period, ["bms"]), live=True)
        channel = network.channels[0]
        now = shared.clock.wall()
        refused = Reading(channel, now, float("nan"), Quality.BAD, Fault.REFUSED_BY_DEVICE)
        await zone.intake.deliver("bms", [refused], now)
        assert f"the device refuses {channel}; the log says why" in zone.now().status.reason
        begin = now // zone.period * zone.period
        await zone.intake.deliver("bms", [Reading(channel, begin, 20.0)], begin)
        await zone.intake.elapse(begin + 3 * zone.period)
        assert "refuses" not in zone.now().status.reason
