"""BACnet datagrams: whatever comes is counted or taken in, makes it send nothing but refusals, poisons no reading."""

import asyncio
import math
from collections import Counter

import pytest

pytest.importorskip("bacpypes3", reason="bacpypes3 is not installed")

from bacpypes3.pdu import IPv4Address
from bacpypes3.primitivedata import Tag, TagClass
from fuzz.fuzzing import raw
from support.sources import bound, source_table

from adapters.bacnet.client import BacnetLink, Device, NoAnswer, Notification, Refused, decoded
from adapters.bacnet.objects import PRESENT_VALUE, STATUS_FLAGS, ObjectId, parse_object
from adapters.bacnet.points import BacnetChannel, Seen, judged, probed
from adapters.bacnet.units import unit_of
from adapters.bacnet.values import Unreadable, bits, flags, number, object_id, text, whole
from adapters.reading import Quality

PEER = ("127.0.7.1", 47808)
OBJECT = ObjectId(0, 1)
TABLE = source_table("bacnet", interface="127.0.0.1", timeout=60.0, retries=0)
KINDS = {"not_bacnet", "frame", "apdu", "notification"}


def frame(apdu: str) -> bytes:
    body = bytes.fromhex("0100" + apdu.replace(" ", ""))
    return b"\x81\x0a" + (4 + len(body)).to_bytes(2) + body


I_AM = frame("10 00 c4020004b1 2205c4 9103 2203e7")
NOTIFICATION = frame("10 02 0907 1c020004b1 2c00000001 393c 4e 0955 2e 4441ac0000 2f 096f 2e 820400 2f 4f")
ANSWER = frame("30 00 0e 0c00000001 1e 2955 4e 4441ac0000 4f 296f 4e 820400 4f 1f")
ERROR = frame("50 00 0e 9101 911f")
REJECT, ABORT = frame("60 00 09"), frame("71 00 04")
SEGMENT = frame("3c 00 00 04 0e 0c00000001")
NETWORK = bytes.fromhex("810a000901800107d1")
FORWARDED = bytes.fromhex("8104001b0a000005bac0") + I_AM[4:]


class Unsent:
    """Where datagrams would go."""

    def sendto(self, data: bytes, target: tuple[str, int]) -> None:
        """Nothing that is sent in answer to a stranger carries anything but a refusal."""
        assert data[0] == 0x81

    def is_closing(self) -> bool:
        """Never."""
        return False

    def close(self) -> None:
        """Nothing to close."""


async def exchange(datagrams: list[bytes]) -> None:
    """A link with a request under way, to which `datagrams` come."""
    malformed: Counter[str] = Counter()

    def note(kind: str) -> None:
        malformed[kind] += 1

    link = BacnetLink(TABLE, note)
    link._application.datagrams._transports = [Unsent()]  # type: ignore[list-item]
    told: list[Notification] = []
    link.listen(told.append)
    device = Device(1201, IPv4Address(PEER), 480, True, True)
    wanted = (PRESENT_VALUE, STATUS_FLAGS)
    asking = asyncio.create_task(link.ask(device, [OBJECT], wanted, 34))
    for _ in range(3):
        await asyncio.sleep(0)
    for datagram in datagrams:
        await link._application.datagrams.accept(datagram, PEER)
        await asyncio.sleep(0)
    assert malformed.keys() <= KINDS, malformed
    seen = [Seen(told_of.values[PRESENT_VALUE]) for told_of in told if PRESENT_VALUE in told_of.values]
    if asking.done():
        try:
            values = asking.result()[OBJECT].values
            value, state = (values[what] for what in wanted)
            if not isinstance(value, Refused):
                seen.append(Seen(value, None if isinstance(state, Refused) else state))
        except (Refused, NoAnswer) as error:
            assert str(error).isprintable()
    else:
        asking.cancel()
    await asyncio.gather(asking, return_exceptions=True)
    for transaction in (*link._application.asap.clientTransactions, *link._application.asap.serverTransactions):
        transaction.stop_timer()
    await link.close()
    for one in seen:
        sound(one)


def sound(seen: Seen) -> None:
    """Readings and probes of what was seen are sound, whatever it is."""
    binding = bound(TABLE, "z/T", unit="degC", device=1201, object=str(OBJECT), stuck_after=1.0)
    channel = BacnetChannel(binding, TABLE.poll)
    for when in (1_772_000_000.0, 1_772_000_001.5):
        reading = channel.read(judged(channel, seen), when, seen.value)
        assert (reading.fault is None) == (reading.quality is not Quality.BAD)
        assert reading.fault is not None or math.isfinite(reading.value)
    probe = probed(channel, seen, 1_772_000_000.0)
    assert "".join((probe.raw, probe.verdict, *probe.hints)).isprintable()


@raw(I_AM, NOTIFICATION, ANSWER, ERROR, REJECT, ABORT, SEGMENT, NETWORK, FORWARDED, examples=250)
def test_bacnet_datagram(data: bytes) -> None:
    """A datagram, and after it a good answer."""
    asyncio.run(exchange([data, ANSWER]))


@raw(b"\x04\x41\xac\x00\x00", b"\x08\x04\x40", b"\x07\x00Room", b"\x0c\x00\x00\x00\x01", examples=300)
def test_bacnet_value(data: bytes) -> None:
    """The octets of a value under any tag."""
    try:
        value = decoded(Tag(TagClass.application, data[0] % 16 if data else 0, len(data), data[1:]))
    except Unreadable as error:
        assert str(error).isprintable()
        return
    for read in (number, flags, bits, whole, text, object_id):
        try:
            found = read(value)
        except Unreadable as error:
            assert str(error).isprintable()
        else:
            assert not isinstance(found, str) or (found.isprintable() and len(found) <= 80)
    sound(Seen(value, value, int.from_bytes(data[:2])))
    unit_of(int.from_bytes(data[:2]))
    try:
        parse_object(data.decode("latin-1"))
    except ValueError as error:
        assert "instance" in str(error)
