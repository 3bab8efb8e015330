"""Clocks that are wrong, set, or asleep: what a live zone makes of them, with clocks that tests set."""

import asyncio
import contextlib
import logging
import sqlite3
from contextlib import asynccontextmanager

import pytest
from support.running_zone import Announced, plumbing
from support.waiting import until
from support.zone_samples import PERIOD, comparable, worker

import service.zone.intake
import service.zone.zone
from adapters.reading import Reading
from service.errors import JournalError
from service.zone.alignment import Alignment, Rules
from service.zone.clock import MOST_SET_ASIDE, PLAUSIBLE, SETTLING, Clock
from service.zone.zone import Zone

NOON = 1_800_000_000
"""2027-01-15T08:00:00Z, on the grid."""

HOUR, DAY, YEAR = 3600.0, 86_400.0, 365.25 * 86_400.0


class Wall:
    """The clocks of a machine: `pass_` lets time go by, `set` moves the wall clock alone."""

    def __init__(self, now=float(NOON)):
        self.now, self.beside = now, 1000.0
        self.clock = Clock(lambda: self.now, lambda: self.beside)

    def pass_(self, seconds):
        self.now += seconds
        self.beside += seconds


class Life:
    """A live zone on a machine whose clock is `wall`."""

    def __init__(self, zone, wall, running, store):
        self.zone, self.wall, self.running, self.store = zone, wall, running, store

    async def live(self, seconds, *, readings=True, step=60.0):
        """Let `seconds` pass: a reading of every channel each minute, and the zone is told the time."""
        for _ in range(int(seconds // step)):
            self.wall.pass_(step)
            if readings:
                now = self.wall.now
                values = {"T_air": 20.0, "T_out": 5.0, "T_adj": 18.0, "u_heat": 0.0}
                await self.zone.intake.deliver("bms", [Reading(f"z/{name}", now, v) for name, v in values.items()], now)
            if self.zone.intake.is_due():
                await self.zone.intake.keep_time()
            await self.zone.settled()

    async def goes_on(self):
        """Live through two periods, after which it runs."""
        await self.live(2 * PERIOD)
        assert self.zone.now().status.state == "running"

    async def set(self, seconds, settle=True):
        """Set the wall clock by `seconds`, and let the zone see that it stays so."""
        self.wall.now += seconds
        if settle:
            await self.live(SETTLING + 2.0, readings=False, step=1.0)


@asynccontextmanager
async def living(folder, wall, announcer=None, max_gap=3):
    async with plumbing(folder, announcer, checkpoint_every=600.0) as shared:
        shared = shared._replace(clock=wall.clock)
        zone = Zone("z", "rbpf", "mark", worker(max_gap=max_gap), shared)
        last = await zone.prepare()
        rules = Rules(zone="z", idle_limit=max_gap + 1, resume_after=last, live=True, earliest=PLAUSIBLE)
        zone.align(Alignment(zone.network, PERIOD, ["bms"], rules), live=True)
        running = asyncio.create_task(zone.run())
        try:
            yield Life(zone, wall, running, shared.store)
        finally:
            await zone.intake.close()
            await asyncio.wait_for(running, 180)


def rows(folder, where="zone = 'z'"):
    with contextlib.closing(sqlite3.connect(folder / "journal.sqlite3")) as connection:
        return [time for (time,) in connection.execute(f"SELECT time FROM samples WHERE {where} ORDER BY time")]


@pytest.mark.parametrize("jump", [HOUR, 8 * HOUR, 50 * YEAR])
async def test_a_clock_set_forward_or_a_machine_that_slept_leaves_a_gap_and_little_work(tmp_path, jump):
    async with living(tmp_path, Wall()) as life:
        await life.live(3 * PERIOD)
        before = len(rows(tmp_path))
        # The steady clock stands still while a machine sleeps, and a clock that is set looks the same.
        await life.set(jump, settle=False)
        await life.live(2 * PERIOD)
        times = rows(tmp_path)
        assert len(times) - before <= 4 + 3, "not an empty sample for every interval of the jump"
        assert times == sorted(times)
        assert life.zone.now().status.state == "running"
        assert life.zone.now().status.segment == 2


async def test_a_clock_that_is_a_little_behind_is_waited_for(tmp_path):
    async with living(tmp_path, Wall()) as life:
        await life.live(3 * PERIOD)
        await life.set(-200.0)
        await life.live(2 * PERIOD)
        assert life.zone.now().status.faults["out_of_order"] > 0
        assert life.zone.now().status.state == "running"
        assert rows(tmp_path) == [NOON + k * PERIOD for k in range(len(rows(tmp_path)))], "none twice, none set aside"
        assert not rows(tmp_path, "zone != 'z'")
        assert life.zone.now().status.segment == 1


async def test_a_clock_set_back_by_an_hour_sets_that_hour_aside_and_goes_on(tmp_path, caplog):
    announcer = Announced()
    with caplog.at_level(logging.WARNING):
        async with living(tmp_path, Wall(), announcer) as life:
            await life.live(2 * HOUR)
            learned = life.zone.worker.standing.state
            kept = [time for time in rows(tmp_path) if time < NOON + HOUR - PERIOD]
            ahead = [time for time in rows(tmp_path) if time >= NOON + HOUR]
            await life.set(-HOUR)
            assert life.zone.worker.standing.state is learned, "what was learned is kept"
            assert rows(tmp_path)[: len(kept)] == kept
            assert rows(tmp_path)[-1] < NOON + HOUR
            assert rows(tmp_path, "zone LIKE 'z@%'")[-len(ahead) :] == ahead, "nothing is deleted"
            assert (life.zone.now().status.state, announcer.states[-1]) == ("stalled", "stalled")
            assert "set back" in life.zone.now().status.reason
            await life.live(HOUR)
            times = rows(tmp_path)
            assert times == sorted(set(times))
            assert times[-1] > NOON + 1.9 * HOUR
            assert life.zone.now().status.state == "running"
            assert life.zone.now().status.segment == 2
            history = await life.zone.history(None, None, 1000)
            assert [row.time for row in history] == sorted({row.time for row in history})
            assert history[-1].time == times[-1]
            last = comparable(life.zone.now().update)
        async with living(tmp_path, life.wall) as again:
            assert comparable(again.zone.now().update) == last, "a restart goes on from there"
    assert "samples that lie ahead of it were set aside" in caplog.text


async def test_a_clock_that_is_set_to_and_fro_changes_nothing(tmp_path):
    async with living(tmp_path, Wall()) as life:
        await life.live(HOUR)
        for _ in range(5):
            await life.set(-HOUR, settle=False)
            await life.live(SETTLING / 2, readings=False, step=1.0)
            await life.set(HOUR, settle=False)
            await life.live(2.0, readings=False, step=1.0)
        assert not rows(tmp_path, "zone != 'z'")
        await life.goes_on()


@pytest.mark.parametrize("wrong", [0.0, 946_684_800.0])
async def test_a_clock_that_was_never_set_is_not_believed_until_it_is(tmp_path, wrong):
    async with living(tmp_path, Wall()) as life:
        await life.live(3 * PERIOD)
    stored = rows(tmp_path)
    wall = Wall(wrong + 10.0)
    async with living(tmp_path, wall) as life:
        await life.live(HOUR)
        assert rows(tmp_path) == stored
        assert not rows(tmp_path, "zone != 'z'")
        status = life.zone.now().status
        assert status.state == "stalled"
        assert "was never set" in status.reason
        assert status.faults["bad_timestamp"] > 0
        await life.set(NOON + 2 * HOUR - wall.now, settle=False)
        await life.goes_on()
        assert rows(tmp_path)[: len(stored)] == stored


async def test_samples_of_a_clock_that_was_ahead_by_years_are_set_aside_at_the_next_start(tmp_path):
    async with living(tmp_path, Wall()) as life:
        await life.live(HOUR)
        await life.set(9 * YEAR, settle=False)
        await life.live(HOUR)
    sane = [time for time in rows(tmp_path) if time < NOON + DAY]
    async with living(tmp_path, Wall(NOON + 2 * HOUR)) as life:
        assert life.zone.now().status.state == "stalled"
        await life.live(SETTLING + 2.0, readings=False, step=1.0)
        assert rows(tmp_path) == sane
        await life.goes_on()


async def test_more_than_a_week_ahead_means_that_the_clock_is_wrong(tmp_path, caplog, monkeypatch):
    monkeypatch.setattr("service.zone.zone.MOST_SET_ASIDE", 6 * PERIOD)
    assert MOST_SET_ASIDE == 7 * DAY
    async with living(tmp_path, Wall()) as life:
        await life.live(HOUR)
        stored = rows(tmp_path)
        await life.set(-HOUR)
        assert rows(tmp_path) == stored
        assert "set the clock, or give the zone's state up with --reset" in life.zone.now().status.reason
        await life.set(HOUR, settle=False)
        await life.goes_on()
    assert "too many to set aside" in caplog.text


def test_what_fails_half_way_is_done_again_with_the_same_result(tmp_path, monkeypatch):
    for module in (service.zone.zone, service.zone.intake):
        monkeypatch.setattr(module, "FIRST_PAUSE", 0.01)

    async def scenario(folder, trouble):
        async with living(folder, Wall()) as life:
            await life.live(2 * HOUR)
            store = life.store
            real = store.journal.set_aside
            failures = [JournalError("the journal failed (disk full); free space")] * trouble

            def failing(zone, after):
                if failures:
                    raise failures.pop()
                real(zone, after)

            store.journal.set_aside = failing
            for attempt in range(trouble + 1):
                # Once more from the same moment, so that all come to the same end.
                life.wall.now = NOON + HOUR - PERIOD / 2 if attempt else life.wall.now - HOUR - PERIOD / 2
                await life.live(SETTLING + 2.0, readings=False, step=1.0)
                await until(lambda: life.zone.now().status.state != "failed")
                await life.zone.settled()
            life.wall.now = NOON + HOUR + 60.0
            await life.live(3 * PERIOD)
            assert life.zone.now().status.state == "running"
            return comparable(life.zone.now().update), rows(folder)

    assert asyncio.run(scenario(tmp_path / "failing", 1)) == asyncio.run(scenario(tmp_path / "well", 0))
