"""What every source of subscriptions promises, over a real broker and a real session."""

import asyncio
import json
import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from support.broker import Party, broker
from support.sources import bound, source_table
from support.tables import tabled
from support.waiting import between, repeated
from support.zenoh_plant import endpoint, listening, session

import adapters.messages.subscribed
from adapters.fields.times import written_to_the_millisecond as iso
from adapters.messages.inbox import Inbox, Incoming

Keys = dict[str, Any]


class Bus(NamedTuple):
    """One way of publishing: its kind of source, what that calls a place, the keys that lead there, and a publisher."""

    kind: str
    noun: str
    keys: Keys
    put: Callable[[str, str | bytes], object]

    def source(self, *channels: Keys, **keys: Any) -> Any:
        """A source of `channels`, by default the room's temperature."""
        table = source_table(self.kind, **self.keys | {"timeout": 2.0} | keys)
        return table.build("bms", [self.bound(table, one) for one in channels or (T,)])

    def bound(self, table: Any, channel: Keys) -> Any:
        """`channel`, whose `at` is the place that it is published on."""
        return bound(table, **{self.noun if key == "at" else key: value for key, value in channel.items()})


@pytest.fixture(params=["mqtt", "zenoh"])
def bus(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Bus]:
    with ExitStack() as stack:
        if request.param == "mqtt":
            running = stack.enter_context(broker(tmp_path))
            party = stack.enter_context(Party(running.port))
            keys = {"host": "127.0.0.1", "port": running.port, "client_id": f"test-{time.monotonic_ns()}"}
            yield Bus("mqtt", "topic", keys, lambda place, payload: party.put(place, payload, qos=1))
        else:
            place = endpoint()
            yield Bus("zenoh", "key", {"connect": [place]}, stack.enter_context(session(listen=place)).put)


T = {"id": "room/T", "at": "bms/room/T", "unit": "degC"}
HALL = {"id": "hall/T", "at": "bms/hall/T", "unit": "degC"}
JSON = {"format": "json", "value": "/value", "time": "/time"}


@tabled
async def test_every_format_arrives(bus: Bus, form: Keys, payload: str) -> None:
    begun = time.time()
    async with listening(bus.source(T | form)) as heard:
        await heard.until(heard.values, lambda: bus.put("bms/room/T", payload))
        assert set(heard.values()) == {21.5}
        assert between(begun, heard.readings[-1].time, time.time())
        assert heard.readings[-1].quality == "good"
        assert between(begun - 1.0, heard.batches[-1].now, time.time() - 1.0)


async def test_a_time_ahead_of_the_clock_is_refused(bus: Bus, caplog: pytest.LogCaptureFixture) -> None:
    async with listening(bus.source(T | JSON)) as heard:
        document = json.dumps({"value": 1, "time": iso(time.time() + 3600)})
        await heard.until(heard.faults, lambda: bus.put("bms/room/T", document))
        assert set(heard.faults()) == {"ahead_of_time"}
    assert f"room/T ({bus.noun} bms/room/T): the payload is dated 3" in caplog.text


async def test_a_bad_publisher_harms_its_channel_only_and_is_told_of_once(
    bus: Bus, caplog: pytest.LogCaptureFixture
) -> None:
    bad = ["warm", b"\xff\xfe", "", "\u200b", "999", "nan", "{}", b"9" * (10 * 2**20)]

    def publish() -> None:
        for payload in bad:
            bus.put("bms/room/T", payload)
        bus.put("bms/hall/T", "20")

    async with listening(bus.source(T, HALL)) as heard:
        await heard.until(lambda: heard.batches)
        await heard.until(lambda: len(heard.values("hall/T")) > 2, publish)
        assert heard.values() == heard.failures == []
        expected = ["non_numeric", "non_numeric", "not_available", "non_numeric", "out_of_range", "not_finite"]
        assert heard.faults()[:8] == [*expected, "non_numeric", "non_numeric"], "in the order in which they were sent"
    # One of each kind that has a sentence.
    assert caplog.text.count(f"room/T ({bus.noun} bms/room/T): the payload") == 2


async def test_a_consumer_that_sleeps_costs_the_oldest_of_the_busy_place_alone(
    bus: Bus, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    put, last = Inbox.put, threading.Event()

    def noted(inbox: Inbox, key: str, incoming: Incoming) -> None:
        put(inbox, key, incoming)
        if incoming.key == "bms/hall/T":
            last.set()

    monkeypatch.setattr(Inbox, "put", noted)
    ours = bus.source(T | {"unit": "1"}, HALL, queue=10)
    async with listening(ours) as heard:
        await heard.until(lambda: heard.values(), lambda: bus.put("bms/room/T", "-1"))
        so_far = len(heard.batches)
        for number in range(500):
            bus.put("bms/room/T", str(number))
        bus.put("bms/hall/T", "7")
        # The event loop is held up, as by a long computation; the client library is not.
        assert last.wait(180)
        await heard.until(lambda: len(heard.batches) > so_far)
        values = [(one.channel, one.value) for one in heard.batches[so_far].readings if one.fault is None]
        assert [value for channel, value in values if channel == "room/T"] == [*range(490, 500)]
        assert ("hall/T", 7.0) in values[:3], "the flood does not delay it"
        assert ours.dropped == 490
        assert heard.faults() == ["overrun"]
    assert caplog.text.count("come faster than they can be taken") == 1


async def test_other_channels_over_the_same_connection(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adapters.messages.subscribed, "LOOK", 0.05)
    ours = bus.source(T)
    room, hall = (bus.bound(ours._table, one) for one in (T, HALL))

    def put() -> None:
        bus.put("bms/room/T", "21.5")
        bus.put("bms/hall/T", "18.5")

    async with listening(ours) as heard:
        await heard.until(heard.values, put)
        assert heard.values("hall/T") == []
        link = ours._link
        ours.rebind([room, hall])
        await heard.until(lambda: heard.values("hall/T"), put)
        ours.rebind([hall])
        # What is still on its way comes first.
        await asyncio.sleep(0.5)
        before, count = len(heard.values()), len(heard.values("hall/T"))
        await heard.until(lambda: len(heard.values("hall/T")) > count + 3, put)
        assert len(heard.values()) == before
        assert ours._link is link
        assert heard.failures == []


async def test_places_on_which_nothing_comes_are_said(
    bus: Bus, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for name, seconds in (("QUIET", 0.1), ("LOOK", 0.05)):
        monkeypatch.setattr(adapters.messages.subscribed, name, seconds)
    caplog.set_level(logging.INFO)
    silence = f"nothing has come for room/T ({bus.noun} bms/room/T) so far; check its {bus.noun} with thermogate probe"
    async with listening(bus.source()) as heard:
        await heard.until(lambda: silence in caplog.text)
    assert "sources.bms: connected (" in caplog.text


async def test_probe_shows_what_comes_and_what_came_elsewhere(bus: Bus) -> None:
    usual = T | {"usual": (5.0, 40.0)}
    channels = [
        usual,
        usual | {"id": "room/cold", "at": "bms/cold"},
        usual | {"id": "room/hot", "at": "bms/hot"},
        T | {"id": "room/bad", "at": "bms/bad"},
        T | {"id": "room/w", "at": "bms/json", "format": "json", "value": "/temp"},
        T | {"id": "room/x", "at": "bms/room/Tt"},
    ]
    sent = {"bms/room/T": "21.5", "bms/cold": "1.8", "bms/hot": "300", "bms/bad": "warm"}
    sent["bms/json"] = '{"temperature": 19.5, "linkquality": 80}'
    probing = asyncio.create_task(bus.source(*channels).probe(1.0))
    with repeated(lambda: [bus.put(place, payload) for place, payload in sent.items()], 0.05):
        await probing
    good, cold, hot, bad, wrong, nothing = probing.result()
    assert (good.value, good.verdict, good.raw, good.place) == (21.5, "good", "21.5", "bms/room/T plain")
    assert (cold.value, cold.verdict) == (1.8, "doubtful: usually 5 to 40 here; if it is right, give valid")
    assert hot.verdict == "implausible: not within -60 to 80"
    assert bad.verdict == "refused: the payload 'warm' is not a number"
    assert wrong.verdict == 'refused: the payload has nothing at "/temp"; look at value'
    assert wrong.hints == ("numbers in it: /temperature 19.5, /linkquality 80",)
    assert nothing.verdict.startswith("nothing came within 1 s, and no")
    assert nothing.hints[0].startswith("heard meanwhile: bms/room/T")
