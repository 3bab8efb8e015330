"""What waits between a client library and the event loop: bounded in number and bytes, read in turns, and fair."""

import json

import pytest
from support.sources import bound, source_table
from support.waiting import turns_beside

from adapters.messages import subscribed
from adapters.messages.inbox import LONGEST_PAYLOAD, MOST_BYTES, MOST_BYTES_OF_ONE, Inbox, Incoming
from adapters.messages.points import MessageChannels
from adapters.messages.subscribed import SubscribedSource
from adapters.payload import senml

NOW = 1_772_000_000.0
TABLE = source_table("zenoh", connect=["tcp/127.0.0.1:1"])


def came(key: str, payload: bytes = b"20") -> Incoming:
    return Incoming(key, payload, len(payload), None, NOW)


def taken(inbox: Inbox) -> list[str]:
    return [one.key for one in inbox.waiting()]


async def test_a_flood_of_bytes_drops_its_own_oldest_samples() -> None:
    inbox = Inbox(["flood", "calm"], 1000)
    inbox.put("calm", came("calm"))
    for _ in range(1000):
        inbox.put("flood", came("flood", bytes(LONGEST_PAYLOAD)))
    found = list(inbox.waiting())
    assert sum(one.incoming.size for one in found if one.key == "flood") == MOST_BYTES_OF_ONE
    assert [(one.key, one.dropped) for one in found if one.dropped] == [("flood", 984)]
    assert [one.key for one in found].count("calm") == 1


async def test_floods_on_many_keys_have_a_bound_together_and_drop_where_most_waits() -> None:
    keys = [f"flood-{number}" for number in range(100)]
    inbox = Inbox(["calm", *keys], 1000)
    inbox.put("calm", came("calm"))
    for _ in range(16):
        for key in keys:
            inbox.put(key, came(key, bytes(LONGEST_PAYLOAD)))
    found = list(inbox.waiting())
    assert sum(one.incoming.size for one in found) <= MOST_BYTES
    assert {one.key for one in found} == {"calm", *keys}
    assert next(one for one in found if one.key == "calm").dropped == 0


async def test_a_sample_waits_for_one_of_each_flood_at_most() -> None:
    inbox = Inbox(["a", "b", "calm"], 1000)
    for _ in range(500):
        inbox.put("a", came("a", bytes(2000)))
        inbox.put("b", came("b", bytes(2000)))
    for _ in range(100):
        assert inbox.take() is not None
    inbox.put("calm", came("calm"))
    assert "calm" in [one.key for one in (inbox.take(), inbox.take(), inbox.take()) if one is not None]
    rest = taken(inbox)
    assert len(rest) == 1000 - 100 - 2
    assert abs(rest.count("a") - rest.count("b")) <= 2, "both floods have the same share"


async def test_those_of_one_key_stay_in_order_and_a_key_that_is_given_up_is_forgotten() -> None:
    inbox = Inbox(["a", "b"], 1000)
    for number in range(50):
        inbox.put("a", came("a", str(number).encode()))
        inbox.put("b", came("b"))
    inbox.listen_to(["a"])
    assert [one.incoming.payload for one in inbox.waiting()] == [str(number).encode() for number in range(50)]
    assert inbox.take() is None
    assert not await inbox.wait(0.01)
    inbox.put("a", came("a"))
    assert await inbox.wait(60.0)
    assert await inbox.wait(60.0), "it is still there"
    assert taken(inbox) == ["a"]


def test_a_message_is_parsed_once_for_all_channels_that_read_it(monkeypatch: pytest.MonkeyPatch) -> None:
    parsed: list[int] = []
    records = senml.records
    monkeypatch.setattr(senml, "records", lambda document: parsed.append(1) or records(document))
    names = [f"T{number}" for number in range(200)]
    listed = [bound(TABLE, f"room/{name}", key="k", format="senml", record=name) for name in names]
    channels = MessageChannels("bms", listed, TABLE)
    sound = json.dumps([{"n": name, "v": 20} for name in names]).encode()
    for payload, count in ((sound, 200), (b'[{"n": 1}]', 200)):
        parsed.clear()
        assert len(list(channels.came("k", came("k", payload)))) == count
        assert len(parsed) == 1


@pytest.fixture
def sliced(monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop has its turn after every message, and at most 100 readings are delivered together."""
    for name, value in (("SLICE_SECONDS", 0.0), ("TOGETHER_SECONDS", float("inf")), ("MOST_TOGETHER", 100)):
        monkeypatch.setattr(subscribed, name, value)


@pytest.mark.usefixtures("sliced")
async def test_the_loop_has_its_turn_between_messages_and_readings_are_delivered_meanwhile() -> None:
    inbox = Inbox(["k"], 1000)
    for _ in range(250):
        inbox.put("k", came("k"))
    source = SubscribedSource("bms", TABLE, [bound(TABLE, "room/T", key="k")])
    with turns_beside() as turns:
        assert [len(await source._readings(inbox)) for _ in range(4)] == [100, 100, 50, 0]
    assert turns() >= 240


@pytest.mark.usefixtures("sliced")
async def test_a_message_of_much_for_many_channels_takes_turns_with_the_messages_of_other_keys() -> None:
    inbox, rooms, records = Inbox(["k", "calm"], 1000), range(5), range(100)
    for first in (0, 1):
        pack = [{"n": "T", "v": 20 + first, "t": -k} for k in reversed(records)]
        inbox.put("k", came("k", json.dumps(pack).encode()))
    inbox.put("calm", came("calm"))
    channels = [bound(TABLE, f"room-{room}/T", key="k", format="senml", record="T") for room in rooms]
    source = SubscribedSource("bms", TABLE, [*channels, bound(TABLE, "calm/T", key="calm")])
    with turns_beside() as turns:
        pieces = [await source._readings(inbox) for _ in range(11)]
    assert turns() >= 990
    assert "calm/T" in [reading.channel for reading in pieces[0][:3]]
    assert max(map(len, pieces)) == 100, "memory holds few of them at a time"
    for room in rooms:
        found = [one for piece in pieces for one in piece if one.channel == f"room-{room}/T"]
        assert [one.value for one in found] == [20.0] * 100 + [21.0] * 100
        assert [round(one.time - NOW) for one in found] == [-k for k in reversed(records)] * 2
