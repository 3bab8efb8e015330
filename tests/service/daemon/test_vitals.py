"""What counts as alive: threads that answer, and zones that get on with what they have."""

import asyncio

import pytest

import service.daemon.vitals
from service.daemon.vitals import Organ, Vitals
from service.records.status import Busy


class Clock:
    """Stands in for the monotonic clock."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        monkeypatch.setattr(service.daemon.vitals.time, "monotonic", lambda: self.now)


class Zone:
    def __init__(self, waiting=0, finished=0):
        self.busy = Busy(waiting, finished)


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


def looked(clock, vitals, zone, *moments):
    """Look at `moments`: (time, waiting, finished)."""
    for now, waiting, finished in moments:
        clock.now, zone.busy = now, Busy(waiting, finished)
        vitals.look(now)
    return vitals.problems()


def test_a_zone_that_hangs_is_found_after_its_patience_and_no_other(clock):
    zones = {"z": (zone := Zone())}
    vitals = Vitals(zones, (), patience=60)
    # One that gets on is well, however much waits; nor does time without anything to do count.
    assert looked(clock, vitals, zone, *((50 * k, 16, k) for k in range(7)), (350, 0, 8), (800, 1, 8)) == []
    assert looked(clock, vitals, zone, (860, 3, 8)) == []
    (problem,) = looked(clock, vitals, zone, (861, 16, 8))
    assert problem == "zones have not finished a sample for 60 s or more: 1; see the log"
    assert vitals.hung() == ["z"]
    assert looked(clock, vitals, zone, (862, 16, 9)) == []
    zones.clear()
    assert looked(clock, vitals, zone, (1000, 16, 9)) == []


async def test_an_organ_that_does_not_answer(clock):
    gate = asyncio.Event()
    errors = iter([None, OSError("disk")])

    async def answer():
        await gate.wait()
        if error := next(errors):
            raise error

    vitals = Vitals({}, (Organ("the journal", answer, 30.0),))
    vitals.look(0.0)
    await asyncio.sleep(0)
    clock.now = 30.0
    vitals.look(30.0)
    assert vitals.problems() == []
    clock.now = 31.0
    assert vitals.problems() == ["the journal has not answered for 31 s"]
    gate.set()
    for _ in range(4):
        await asyncio.sleep(0)
    # The next question is answered with an error, which is an answer.
    vitals.look(31.0)
    for _ in range(4):
        await asyncio.sleep(0)
    clock.now = 100.0
    vitals.look(100.0)
    assert vitals.problems() == []
