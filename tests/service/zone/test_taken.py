"""Readings that a zone is handed while somebody waits: accepted once, durable, and recalled after a start."""

import asyncio
from collections import Counter
from math import isnan
from unittest.mock import AsyncMock, Mock

import pytest
from support.running_zone import make, plumbing
from support.zone_samples import PERIOD

import service.zone.intake
from adapters.reading import Fault, Quality, Reading
from estimator.network.presets import network
from service.errors import JournalError, ServiceError
from service.records.asker import Asker, asked_by
from service.records.receipt import Receipt
from service.store.audit import AUDIT
from service.zone.alignment import Alignment, Rules
from service.zone.clock import Clock

NETWORK = network("ecolar-6r4c")
OUTPUT, INPUT = NETWORK.measured[0], NETWORK.inputs[0]
DAY = 1_772_000_000 // 86400 * 86400
CHANNELS = {name: f"z/{name}" for name in NETWORK.channels}


def reading(channel, time, value=20.0, fault=None):
    quality = Quality.GOOD if fault is None else Quality.BAD
    return Reading(CHANNELS[channel], DAY + time, value, quality, fault)


def aligned(zone, after=None):
    zone.align(Alignment(NETWORK, PERIOD, ["post"], Rules(zone="z", resume_after=after, live=True)), live=True)
    return zone


async def test_each_channel_and_time_is_accepted_once(tmp_path):
    async with plumbing(tmp_path) as shared:
        zone = aligned(make(shared))
        first = [reading(OUTPUT, 10.0), reading(INPUT, 10.0, 5.0)]
        assert await zone.intake.take("post", first) == Receipt(2, 0, 0, Counter())
        assert await zone.intake.take("post", first) == Receipt(0, 2, 0, Counter())
        again = [reading(OUTPUT, 10.0, 99.0), reading(OUTPUT, 11.0), reading(OUTPUT, 11.0)]
        assert await zone.intake.take("post", again) == Receipt(1, 2, 0, Counter())
        assert zone.now().status.faults == {}


async def test_who_wrote_a_channel_is_known_and_another_one_is_told_of(tmp_path, caplog):
    async with plumbing(tmp_path) as shared:
        zone = aligned(make(shared))
        await zone.intake.deliver("bms", [reading(INPUT, 9.0, 5.0)], DAY + 9.0)
        for key, time in (("key one", 10.0), ("key one", 11.0), ("key two", 12.0), ("key one", 12.0)):
            asked_by(Asker(key))
            await zone.intake.take("post", [reading(OUTPUT, time)])
        # A repeated reading is not written.
        assert zone.now().status.writers == {INPUT: "source bms", OUTPUT: "key two"}
    told = [record.getMessage() for record in caplog.records if record.name == AUDIT.name]
    assert told == [
        f"key one writes {OUTPUT} of zone 'z' from now on",
        f"key two writes {OUTPUT} of zone 'z' from now on, until now key one",
    ]


@pytest.mark.parametrize("failing", [False, True])
async def test_a_sample_goes_on_where_its_source_is_stopped_meanwhile(tmp_path, monkeypatch, failing):
    async with plumbing(tmp_path) as shared:
        zone = aligned(make(shared))
        store, held = shared.store, asyncio.Event()
        append = store.append

        async def slowly(name, sample):
            await held.wait()
            if failing and not failed:
                failed.append(sample.time)
                raise JournalError("the disk is full")
            await append(name, sample)

        failed: list[int] = []
        monkeypatch.setattr(store, "append", slowly)
        monkeypatch.setattr(service.zone.intake, "FIRST_PAUSE", 0.01)
        await zone.intake.deliver("post", [reading(OUTPUT, 10.0)], DAY + 10.0)
        feed = asyncio.create_task(zone.intake.deliver("post", [reading(OUTPUT, PERIOD + 10.0)], DAY + PERIOD + 10.0))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        feed.cancel()
        held.set()
        with pytest.raises(asyncio.CancelledError):
            await feed
        async with zone.intake.accepting:
            pass
        assert [sample.time for sample in await store.samples_after("z", None)] == [DAY]
        assert zone.busy.waiting == 1


async def test_a_zone_closes_while_the_journal_fails(tmp_path, monkeypatch):
    async with plumbing(tmp_path) as shared:
        zone = aligned(make(shared))
        monkeypatch.setattr(shared.store, "append", AsyncMock(side_effect=JournalError("the disk is full")))
        await zone.intake.deliver("post", [reading(OUTPUT, 10.0)], DAY + 10.0)
        delivered = asyncio.create_task(zone.intake.elapse(DAY + 3 * PERIOD))
        await asyncio.sleep(0.05)
        await zone.intake.close()
        await delivered
        assert await shared.store.samples_after("z", None) == []


async def test_what_is_refused_is_counted_by_its_fault(tmp_path):
    async with plumbing(tmp_path) as shared:
        zone = aligned(make(shared))
        await zone.intake.take("post", [reading(OUTPUT, 10.0)])
        await zone.intake.elapse(DAY + PERIOD)
        wrong = [reading(INPUT, 11.0), reading(INPUT, PERIOD + 1.0, float("nan"), Fault.OUT_OF_RANGE)]
        receipt = await zone.intake.take("post", [*wrong, reading(INPUT, PERIOD + 2.0), reading(OUTPUT, 10.0)])
        refused = Counter({Fault.OUT_OF_ORDER: 1, Fault.OUT_OF_RANGE: 1})
        assert receipt == Receipt(1, 1, 0, refused), "what has closed with its interval is known, too"
        assert zone.now().status.faults == {"out_of_order": 1, "out_of_range": 1}


async def test_a_start_recalls_what_had_not_closed_and_nothing_else(tmp_path):
    async with plumbing(tmp_path) as shared:
        zone = aligned(make(shared))
        await zone.intake.take("post", [reading(OUTPUT, 10.0), reading(INPUT, 10.0)])
        await zone.intake.elapse(DAY + PERIOD)
        uncertain = reading(INPUT, PERIOD + 7.0, 3.5)._replace(quality=Quality.UNCERTAIN)
        await zone.intake.take("post", [reading(OUTPUT, PERIOD + 5.0, 21.25), uncertain])
    # Nothing of the zone is left but the journal, as after a crash.
    async with plumbing(tmp_path) as shared:
        zone = make(shared)
        last = await zone.prepare()
        assert last == DAY
        await aligned(zone, last).intake.recall()
        assert (await zone.intake.take("post", [reading(OUTPUT, PERIOD + 5.0), uncertain])).repeated == 2
        assert (await zone.intake.take("post", [reading(OUTPUT, 10.0)])).repeated == 1
        await zone.intake.elapse(DAY + 2 * PERIOD)
        (sample,) = await shared.store.samples_after("z", DAY)
        assert (sample.time, sample.outputs[0], sample.inputs[0]) == (DAY + PERIOD, 21.25, 3.5)
        assert sample.input_quality[0] is Quality.UNCERTAIN
        assert all(isnan(value) for value in sample.inputs[1:])
        assert zone.now().status.faults == {}


async def test_where_the_journal_fails_nothing_is_promised_and_the_next_try_is(tmp_path, monkeypatch):
    async with plumbing(tmp_path) as shared:
        zone = aligned(make(shared))
        full = JournalError("the journal failed (disk full); free space on its disk")
        with monkeypatch.context() as failing:
            failing.setattr(shared.store.journal, "append_all", Mock(side_effect=full))
            with pytest.raises(JournalError):
                await zone.intake.take("post", [reading(OUTPUT, 10.0, 21.5)])
        assert await shared.store.run(shared.store.journal.kept, "z", 0.0) == []
        assert (await zone.intake.take("post", [reading(OUTPUT, 10.0, 99.0)])).repeated == 1
        kept = await shared.store.run(shared.store.journal.kept, "z", 0.0)
        assert kept == [reading(OUTPUT, 10.0, 21.5)], "what the sample will hold is what is on disk"


async def test_a_zone_that_is_being_stopped_takes_nothing(tmp_path):
    async with plumbing(tmp_path) as shared:
        zone = aligned(make(shared))
        await zone.intake.close()
        with pytest.raises(ServiceError, match="being stopped or replaced; post the readings again"):
            await zone.intake.take("post", [reading(OUTPUT, 10.0)])
        assert await shared.store.run(shared.store.journal.kept, "z", 0.0) == []


async def test_clocks_are_those_of_the_machine(tmp_path):
    """What is posted does not move a zone's time on."""
    async with plumbing(tmp_path) as shared:
        zone = aligned(make(shared._replace(clock=Clock(lambda: DAY + 1.0, lambda: 0.0))))
        await zone.intake.take("post", [reading(OUTPUT, 10.0), reading(OUTPUT, 5 * PERIOD)])
        assert await shared.store.run(shared.store.journal.last_sample_time, "z") is None
        assert (await zone.intake.take("post", [reading(OUTPUT, 2 * PERIOD)])).accepted == 1
