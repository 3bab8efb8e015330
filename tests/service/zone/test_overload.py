"""What happens when samples or readings come faster than a zone can take them: bounded, in order, nothing lost."""

import asyncio
import logging
import threading
from math import inf

import pytest
from support.running_zone import Announced, Shown, alone, caught_up, finished, plumbing, straight
from support.zone_samples import PERIOD, comparable, sample, worker

import service.zone.alignment
from adapters.reading import Fault, Reading
from estimator.network.presets import network
from service.publish.metrics import Metrics
from service.zone import mailbox
from service.zone.alignment import Alignment, Rules
from service.zone.recovery import next_moment
from service.zone.zone import Zone


def held_zone(shared, allowed, name="z"):
    """A zone whose steps wait until they are allowed."""
    return Zone(name, "rbpf", "mark", Shown(worker(), lambda item: allowed.wait(180)), shared)


async def started(zone, *, live, pace=inf):
    await zone.prepare()
    zone.align(Alignment(zone.network, PERIOD, ["bms"], Rules(zone="z", live=live)), live, pace)
    return asyncio.create_task(zone.run())


async def test_live_samples_never_wait_for_the_estimator_and_none_is_lost(tmp_path):
    allowed, announcer = threading.Event(), Announced()
    async with plumbing(tmp_path, announcer) as shared:
        zone = held_zone(shared, allowed)
        running = await started(zone, live=True)
        items = [sample(k) for k in range(120)]
        await zone.intake.accept(items)
        assert zone.busy.waiting <= mailbox.ROOM + 2, "with the one under way, and what is left to the journal"
        # Each was journaled.
        assert await shared.store.run(shared.store.journal.last_sample_time, "z") == items[-1].time
        assert zone.now().status.samples == 0
        allowed.set()
        await caught_up(zone, items)
        more = [sample(k) for k in range(120, 125)]
        await zone.intake.accept(more)
        await caught_up(zone, more)
        await finished(zone, running)
        assert [comparable(update) for _, update in announcer.updates] == straight(items + more)


async def test_live_samples_that_come_while_the_journal_is_read_are_not_lost(tmp_path):
    async with alone(tmp_path) as (zone, _):
        running = await started(zone, live=True)
        items = [sample(k) for k in range(300)]
        # In portions, so that the mailbox overflows and empties over and over.
        for first in range(0, len(items), 30):
            await zone.intake.accept(items[first : first + 30])
        await caught_up(zone, items)
        await finished(zone, running)
        assert [row.time for row in await zone.history(None, None, 1000)] == [item.time for item in items]
        assert comparable(zone.now().update) == straight(items)[-1]


async def test_a_recording_waits_for_the_estimator(tmp_path):
    allowed = threading.Event()
    async with plumbing(tmp_path) as shared:
        zone = held_zone(shared, allowed)
        running = await started(zone, live=False)
        items = [sample(k) for k in range(60)]
        accepting = asyncio.create_task(zone.intake.accept(items))
        # One is in the estimator's hands and one waits at the door.
        async with asyncio.timeout(180):
            while await shared.store.run(shared.store.journal.last_sample_time, "z") != items[mailbox.ROOM + 1].time:
                await asyncio.sleep(0.01)
        await asyncio.sleep(0.3)
        assert not accepting.done()
        assert zone.busy.waiting == mailbox.ROOM + 1, "with the one under way"
        assert await shared.store.run(shared.store.journal.last_sample_time, "z") == items[mailbox.ROOM + 1].time
        allowed.set()
        await accepting
        await caught_up(zone, items)
        await finished(zone, running)
        assert comparable(zone.now().update) == straight(items)[-1]


async def test_a_zone_that_is_left_behind_is_stalled_and_says_so_until_it_has_caught_up(tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        allowed, announcer = threading.Event(), Announced()
        async with plumbing(tmp_path, announcer) as shared:
            zone = held_zone(shared, allowed)
            allowed.set()
            running = await started(zone, live=False, pace=PERIOD / 0.05)
            items = [sample(k) for k in range(8)]
            await zone.intake.accept(items[:1])
            await caught_up(zone, items[:1])
            allowed.clear()
            await zone.intake.accept(items[1:])
            await asyncio.sleep(0.2)
            assert zone.now().status.state == "stalled"
            assert "behind its telemetry, of which a sample comes every 0.05 s" in zone.now().status.reason
            allowed.set()
            await caught_up(zone, items)
            await finished(zone, running)
            assert zone.now().status.overruns >= 7
            assert zone.now().status.delay > 0.05
            # A late forecast is announced as one that the zone cannot vouch for.
            assert announcer.states[-2] == "stalled"
            exposed = Metrics({"z": zone}).registry
            assert exposed.get_sample_value("thermogate_overruns_total", {"zone": "z"}) == zone.now().status.overruns
            assert exposed.get_sample_value("thermogate_forecast_delay_seconds", {"zone": "z"}) > 0.05
    assert caplog.text.count("a forecast came") == 1


def test_checkpoints_of_many_zones_have_moments_of_their_own():
    moments = sorted(next_moment(f"z{k}", 300.0, now=12_345.0) % 300.0 for k in range(200))
    counts = [sum(first <= moment < first + 30.0 for moment in moments) for first in range(0, 300, 30)]
    assert min(counts) >= 5, "spread over the whole time between two checkpoints"
    assert 12_345.0 < next_moment("z7", 300.0, now=12_345.0) <= 12_645.0
    assert next_moment("z7", 300.0, now=12_345.0) % 300.0 == pytest.approx(
        next_moment("z7", 300.0, now=99_999.0) % 300.0
    )


def test_a_flood_of_readings_is_bounded_per_channel_and_interval(monkeypatch):
    monkeypatch.setattr(service.zone.alignment, "MOST_READINGS", 50)
    align = Alignment(network("tite"), PERIOD, ["bms"], Rules(live=True))
    flood = [Reading("T_i", 0.1 * k, 20.0) for k in range(400)]
    align.add("bms", [*flood, Reading("T_out", 1.0, 5.0), Reading("u_heat", 1.0, 0.0)], 40.0)
    assert align.faults == {Fault.OVERRUN: 350}
    (closed,) = align.elapse(float(PERIOD))
    assert closed.outputs[0] == 20.0
    assert closed.inputs[0] == 5.0
