"""Feeding zones from sources that fail, come back, are misconfigured, or end."""

import asyncio
import logging
import random
from math import inf

import pytest

import service.daemon.supply.feeding
from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.reading import Batch, Reading
from adapters.routing import Router
from service.daemon.supply.feeding import feed


class Scripted:
    """A source that plays one act per call of `batches`: batches to deliver, then what to raise (None: end)."""

    name = "bms"

    def __init__(self, *acts):
        self.acts, self.starts = list(acts), []

    async def batches(self, start):
        self.starts.append(start)
        batches, error = self.acts.pop(0)
        for batch in batches:
            yield batch
        if error is not None:
            raise error

    async def close(self):
        pass


class Recorder:
    """A zone that notes what it is told."""

    def __init__(self):
        self.told, self.intake = [], self

    async def deliver(self, source, readings, now):
        self.told.append(("deliver", now, len(readings)))

    async def end(self, source):
        self.told.append(("end", source))

    async def source_failed(self, source, reason):
        self.told.append(("failed", reason))


def batch(now):
    return Batch([Reading("z/T_i", now, 20.0)], now)


@pytest.fixture(autouse=True)
def pauses(monkeypatch):
    """The pauses that were slept, without sleeping them."""
    slept = []

    async def sleep(seconds):
        slept.append(seconds)

    monkeypatch.setattr(service.daemon.supply.feeding.asyncio, "sleep", sleep)
    monkeypatch.setattr(service.daemon.supply.feeding.random, "uniform", lambda lower, upper: upper)
    assert service.daemon.supply.feeding.LONGEST_PAUSE <= 30.0
    return slept


def run(source, start=None):
    zone = Recorder()
    asyncio.run(feed(source, Router("bms", ["z/T_i"]), {"z": zone}, start))
    return zone.told


class Leaving(Recorder):
    """A zone that a reload takes away another one beside, as it is told."""

    def __init__(self, zones, other):
        super().__init__()
        self._zones, self._other = zones, other

    async def end(self, source):
        await super().end(source)
        self._zones.pop(self._other, None)

    async def source_failed(self, source, reason):
        await super().source_failed(source, reason)
        self._zones.pop(self._other, None)


@pytest.mark.parametrize("error", [None, SourceUnavailable("sources.bms: no answer")])
def test_a_zone_that_a_reload_takes_away_meanwhile_does_not_end_the_source(error):
    zones = {}
    zones |= {"a": Leaving(zones, "b"), "b": Recorder(), "c": Recorder()}
    acts = [([], error), ([batch(1.0)], None)] if error else [([], None)]
    channels = [f"{name}/T_i" for name in zones]
    asyncio.run(feed(Scripted(*acts), Router("bms", [*channels, "z/T_i"]), zones, None))
    assert list(zones) == ["a", "c"]
    assert zones["c"].told[-1] == ("end", "bms")


def test_a_source_that_fails_is_asked_again_for_what_follows(pauses, caplog):
    down = SourceUnavailable("sources.bms: no answer from 127.0.0.1; check the cable")
    source = Scripted(([batch(1.0)], down), ([], down), ([], down), ([batch(2.0)], None))
    told = run(source)
    assert [entry[0] for entry in told] == ["deliver", "failed", "failed", "failed", "deliver", "end"]
    assert told[1] == ("failed", str(down))
    assert pauses == [1.0, 2.0, 4.0]
    assert source.starts[0] is None
    assert all(1.0 < start < 1.0001 for start in source.starts[1:]), "what was delivered is not asked for again"
    assert caplog.text.count("check the cable; trying again") == 3


def test_pauses_are_bounded_and_short_again_after_progress(pauses):
    down = SourceUnavailable("sources.bms: down")
    run(Scripted(*[([], down)] * 8, ([batch(5.0)], down), ([], None)))
    assert pauses == [1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 30.0, 1.0]


def test_pauses_differ_so_that_many_daemons_do_not_come_back_at_once(pauses, monkeypatch):
    monkeypatch.setattr(service.daemon.supply.feeding.random, "uniform", random.Random(5).uniform)
    run(Scripted(*[([], SourceUnavailable("sources.bms: down"))] * 40, ([], None)))
    assert all(15.0 <= pause <= 30.0 for pause in pauses[5:])
    assert len(set(pauses[5:])) > 30


def test_a_source_that_is_described_wrongly_stays_off(pauses, caplog):
    told = run(Scripted(([], SourceConfigError("sources.bms: no column 'T'; name another"))))
    assert told == [("failed", "sources.bms: no column 'T'; name another")]
    assert pauses == []
    assert "it stays off" in caplog.text


def test_an_unexpected_error_is_retried_without_a_traceback(pauses, caplog):
    with caplog.at_level(logging.INFO):
        told = run(Scripted(([], ZeroDivisionError("oops")), ([batch(-inf)], None)))
    assert told[0] == ("failed", "sources.bms failed: ZeroDivisionError('oops')")
    assert told[-1] == ("end", "bms")
    assert pauses == [1.0]
    assert "Traceback" not in caplog.text


def test_a_zone_that_fails_does_not_keep_the_others_from_their_readings(pauses, caplog):
    class Failing(Recorder):
        async def deliver(self, source, readings, now):
            if not self.told:
                self.told.append(("failing", now, 0))
                raise RuntimeError("out of order")
            await super().deliver(source, readings, now)

    ids = [f"z{index}" for index in range(2 * service.daemon.supply.feeding.TOGETHER)]
    zones = {zone: Failing() if zone == "z0" else Recorder() for zone in ids}
    together = Batch([Reading(f"{zone}/T_i", 1.0, 20.0) for zone in ids], 1.0)
    source = Scripted(([together], None), ([together], None))
    asyncio.run(feed(source, Router("bms", [f"{zone}/T_i" for zone in ids]), zones, None))
    assert zones["z0"].told[0] == ("failing", 1.0, 0)
    assert zones["z1"].told[0] == ("deliver", 1.0, 1)
    assert all(("deliver", 1.0, 1) in zone.told for zone in zones.values())
    assert source.starts == [None, None]
    assert "out of order" in caplog.text
