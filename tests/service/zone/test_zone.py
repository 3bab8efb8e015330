"""A zone in the daemon: samples journaled before they are used, failures retried, poison passed over, nothing lost."""

import asyncio
import logging

import numpy as np
import pytest
from numba.core.errors import NumbaError
from support.forecasts import question
from support.running_zone import Announced, alone, caught_up, fed, finished, make, plumbing, straight, through
from support.waiting import until
from support.zone_samples import PERIOD, comparable, sample, worker

import service.zone.intake
import service.zone.zone
from adapters.reading import Reading
from estimator.diagnosis.finding import METER_DEAD, SENSOR_STUCK
from estimator.diagnosis.telemetry.lies import Suspicion
from service.errors import JournalError, ServiceError
from service.forecast.learned import ParametersQuestion
from service.publish.payloads import StatusPayload
from service.zone.alignment import Alignment, Rules
from service.zone.recovery import is_of_the_environment
from service.zone.zone import ATTEMPTS, Zone


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch):
    for module in (service.zone.zone, service.zone.intake):
        monkeypatch.setattr(module, "FIRST_PAUSE", 0.01)
        monkeypatch.setattr(module, "LONGEST_PAUSE", 0.02)


class Forgetful:
    """An estimator that cannot learn from one value, a few times."""

    def __init__(self, inner, value, times):
        self.__dict__ |= {"_inner": inner, "_value": value, "_times": times}

    def __getattr__(self, name):
        return getattr(self._inner, name)

    def update(self, state, outputs):
        if outputs[0] == self._value and self._times:
            self.__dict__["_times"] -= 1
            raise MemoryError("there is no memory")
        return self._inner.update(state, outputs)


async def test_a_checkpoint_that_is_due_while_a_step_fails_does_not_skip_its_sample(tmp_path):
    items = [sample(k) for k in range(30)]
    items[20] = sample(20, y=20.123)
    failing = worker()
    failing.estimator = Forgetful(failing.estimator, 20.123, times=3)
    # A checkpoint is due before every step.
    async with plumbing(tmp_path, checkpoint_every=1e-9) as shared:
        zone = Zone("z", "rbpf", "mark", failing, shared)
        await through(zone, items)
        assert [row.time for row in await zone.history(None, None, 100)] == [item.time for item in items]
        assert comparable(zone.now().update) == straight(items)[-1]


async def test_a_sample_that_always_fails_is_passed_over_and_the_zone_goes_on(tmp_path, caplog):
    with caplog.at_level(logging.ERROR):
        async with plumbing(tmp_path) as shared:
            items = [sample(k) for k in range(30)]
            failures = {items[10].time: 10**6}
            zone = make(shared, failures)
            await through(zone, items)
            assert 10**6 - failures[items[10].time] >= ATTEMPTS
            rows = await zone.history(None, None, 100)
            assert items[10].time not in [row.time for row in rows]
            assert rows[-1].time == items[-1].time
            # The same as if that interval had never come.
            assert comparable(zone.now().update) == straight(items[:10] + items[11:])[-1]
    assert f"passes over its sample at {10 * PERIOD}" in caplog.text


ENVIRONMENT = {
    True: [OSError(28, "full"), MemoryError(), EOFError(), RuntimeError("can't start new thread"), NumbaError("n")],
    False: [ValueError("it does not follow"), RuntimeError("singular matrix")],
}


@pytest.mark.parametrize("environment", ENVIRONMENT)
def test_what_is_of_the_environment_or_caused_by_it_is_no_samples_fault(environment):
    for error in ENVIRONMENT[environment]:
        outer = RuntimeError("the step failed")
        outer.__cause__ = error
        assert (is_of_the_environment(error), is_of_the_environment(outer)) == (environment, environment)


async def test_the_log_tells_what_of_the_telemetry_is_suspected_and_how_that_ends(tmp_path, caplog, monkeypatch):
    lies = {5 * 3600: [Suspicion(SENSOR_STUCK, 0, 0.0)], 9 * 3600: [Suspicion(METER_DEAD, 1, -7.0 * 86400)]}
    monkeypatch.setattr("estimator.loop.lies.looked", lambda *given: tuple(lies.get(given[3] // 3600 * 3600, ())))
    with caplog.at_level(logging.INFO, "service.zone"):
        async with plumbing(tmp_path) as shared:
            await through(make(shared, {}), [sample(k) for k in range(12 * 3600 // PERIOD)])
    ends = ["00Z at the earliest)", "00Z has ended", "00Z at the earliest)", "true from now on"]
    assert [one.message.endswith(end) for one, end in zip(caplog.records, ends, strict=True)] == [True] * 4


async def test_no_sample_is_passed_over_because_the_disk_is_full(tmp_path, caplog):
    async with plumbing(tmp_path) as shared:
        items = [sample(k) for k in range(12)]
        zone = make(shared, {items[5].time: 3 * ATTEMPTS}, error=OSError(28, "No space left on device"))
        await through(zone, items)
        assert [row.time for row in await zone.history(None, None, 100)] == [item.time for item in items]
        assert comparable(zone.now().update) == straight(items)[-1]
    assert "passes over" not in caplog.text


async def test_while_a_zone_is_failed_others_go_on_and_its_samples_are_kept(tmp_path, monkeypatch):
    waited = asyncio.Event()

    async def within(closed, seconds):
        await waited.wait()
        return False

    monkeypatch.setattr(service.zone.zone, "within", within)
    async with plumbing(tmp_path) as shared:
        items = [sample(k) for k in range(60)]
        sick, well = make(shared, {items[0].time: 1}, "sick"), make(shared, None, "well")
        tasks = [await fed(sick, items[:1]), await fed(well, items[:1])]
        await until(lambda: sick.now().status.state == "failed")
        # More than its mailbox holds, and no one waits for it.
        await sick.intake.accept(items[1:])
        await well.intake.accept(items[1:])
        assert sick.now().status.state == "failed"
        assert "cannot step over 0" in sick.now().status.reason
        await caught_up(well, items)
        waited.set()
        await caught_up(sick, items)
        for zone, task in zip((sick, well), tasks, strict=True):
            await finished(zone, task)
        assert comparable(sick.now().update) == comparable(well.now().update)


async def test_an_announcer_that_fails_does_not_stop_the_zone(tmp_path, caplog):
    announcer = Announced()
    announcer.broken = True
    async with alone(tmp_path, announcer) as (zone, _):
        await finished(zone, await fed(zone, [sample(k) for k in range(5)]))
        assert zone.now().status.samples == 5
        assert zone.now().status.state == "running"
    assert "the session is gone" in caplog.text


async def test_a_journal_that_cannot_be_written_holds_the_sample_until_it_can(tmp_path, monkeypatch, caplog):
    async with alone(tmp_path) as (zone, shared):
        real, failures = shared.store.append, [JournalError("the journal failed (disk full); free space")] * 3

        async def failing(name, item):
            if failures:
                raise failures.pop()
            return await real(name, item)

        monkeypatch.setattr(shared.store, "append", failing)
        accepting = asyncio.create_task(fed(zone, [sample(0), sample(1)]))
        while zone.now().status.state != "failed":
            await asyncio.sleep(0)
        assert "disk full" in zone.now().status.reason
        await finished(zone, await accepting)
        assert zone.now().status.state == "running"
        assert zone.now().status.samples == 2
    assert caplog.text.count("disk full") == 3


async def test_a_zone_says_what_it_waits_for(tmp_path):
    async with alone(tmp_path) as (zone, _):
        assert (zone.now().status.state, zone.now().update, await zone.ask(question(3))) == ("waiting", None, None)
        assert await zone.ask(ParametersQuestion((0.5,))) is None
        running = await fed(zone, [sample(0, y=float("nan")), sample(1)])
        await until(lambda: zone.now().update)
        assert len((await zone.ask(question(2, {"u_heat": np.array([0.0, 500.0])}))).outputs[0].mean) == 3
        assert (await zone.ask(ParametersQuestion((0.5,)))).summary.parameters.shape == (10, 1)
        zone.align(Alignment(zone.network, PERIOD, ["only"], Rules(zone="z")))
        assert zone.now().status.state == "running"
        await zone.end("only")
        await until(lambda: zone.now().status.state == "stalled")
        assert "come to an end" in zone.now().status.reason
        await finished(zone, running)


async def test_a_source_that_does_not_deliver_shows_on_its_zone_until_it_does(tmp_path):
    announcer = Announced()
    async with alone(tmp_path, announcer) as (zone, _):
        running = await fed(zone, [sample(0)])
        zone.align(Alignment(zone.network, PERIOD, ["bms"], Rules(zone="z")))
        await zone.source_failed("bms", "sources.bms: the file is gone; put it back")
        assert zone.now().status.state == "stalled"
        assert "the file is gone" in zone.now().status.reason
        assert announcer.states[-1] == "stalled"
        await zone.intake.deliver("bms", [], 0.0)
        await finished(zone, running)
        assert zone.now().status.state == "running"


async def test_a_set_point_is_among_the_channels_of_a_zone_that_has_one(tmp_path):
    async with alone(tmp_path) as (zone, _):
        running = await fed(zone, [sample(0)])
        zone.align(Alignment(zone.network, PERIOD, ["bms"], Rules(zone="z")))
        assert zone.now().status.channels == zone.network.channels
        zone.align(Alignment(zone.network, PERIOD, ["bms"], Rules(zone="z", setpoint_age=3600.0)))
        await zone.intake.deliver("bms", [Reading("z/setpoint", PERIOD + 10.0, 21.0)], 2 * PERIOD)
        *_, last = StatusPayload.of(zone.now().status, None).channels
        assert (last.channel, last.last_good, last.age_s) == ("setpoint", PERIOD + 10.0, PERIOD - 10.0)
        await finished(zone, running)


async def test_a_recording_that_had_ended_before_this_start_still_tells_its_time(tmp_path):
    async with alone(tmp_path) as (zone, _):
        await finished(zone, await fed(zone, [sample(0), sample(1)]))
    announcer = Announced()
    async with alone(tmp_path, announcer) as (zone, _):
        await zone.prepare()
        zone.align(Alignment(zone.network, PERIOD, ["only", "other"], Rules(zone="z")))
        await zone.end("only")
        await zone.intake.deliver("other", [], 9000.0)
        assert zone.now().status.now == 2 * PERIOD, "of two the earlier one"
        await zone.end("other")
        await finished(zone, asyncio.create_task(zone.run()))
        assert announcer.states == ["running", "stalled"]


async def test_a_hurried_zone_saves_and_leaves_the_rest_to_the_journal(tmp_path):
    async with alone(tmp_path) as (zone, shared):
        items = [sample(k) for k in range(12)]
        await zone.prepare()
        await zone.intake.accept(items)
        zone.hurry()
        await zone.run()
        assert zone.now().status.samples < len(items)
        again = make(shared)
        assert await again.prepare() == items[-1].time
        assert comparable(again.now().update) == straight(items)[-1]


async def test_a_fan_is_given_up_when_the_daemon_stops(tmp_path):
    async with alone(tmp_path) as (zone, shared):
        await finished(zone, await fed(zone, [sample(0)]))
        shared.stopping.set()
        with pytest.raises(ServiceError, match="the daemon is stopping"):
            await zone.ask(question(500))
