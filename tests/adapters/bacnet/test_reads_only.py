"""BACnet cannot write: no code names a verb that does, the link has none, and the wire would not carry it."""

import ast
import asyncio
from pathlib import Path

import pytest

pytest.importorskip("bacpypes3", reason="bacpypes3 is not installed")

from bacpypes3.apdu import (
    ConfirmedRequestPDU,
    UnconfirmedRequestPDU,
    WritePropertyRequest,
    confirmed_request_types,
    unconfirmed_request_types,
)
from bacpypes3.primitivedata import ObjectIdentifier, Real
from support.bacnet_plant import READS, Peer, free_udp_port, serving
from support.sources import source_table

from adapters.bacnet.client import BacnetLink
from adapters.bacnet.objects import ObjectId, Property
from adapters.bacnet.stack import REQUESTS, NotReading, Stack

ROOT = Path(__file__).parents[3]
KNOWING = {"client.py", "stack.py"}
REQUEST_TYPES = [*confirmed_request_types.values(), *unconfirmed_request_types.values()]
OTHERS = [kind for kind in REQUEST_TYPES if kind.__name__ not in READS]


def imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            yield node.module or "", [alias.name for alias in node.names]
        elif isinstance(node, ast.Import):
            yield from ((alias.name, []) for alias in node.names)


def test_two_modules_know_bacpypes3():
    # The simulated building is devices, and devices may know everything.
    paths = [
        path
        for package in ("adapters", "service", "replay", "thermogate")
        for path in sorted((ROOT / package).rglob("*.py"))
        if ROOT / "replay" / "bms" not in path.parents
    ]
    assert len(paths) > 100
    knowing = [path for path in paths if any(module.startswith("bacpypes3") for module, _ in imported(path))]
    assert {path.relative_to(ROOT / "adapters" / "bacnet").as_posix() for path in knowing} == KNOWING


@pytest.mark.parametrize("path", sorted((ROOT / "adapters" / "bacnet").glob("*.py")), ids=lambda path: path.name)
def test_no_module_of_the_adapter_names_a_request_that_writes(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    forbidden = {kind.__name__ for kind in OTHERS} - {"IAmRequest", "UnconfirmedCOVNotificationRequest"}
    named = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    named |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    named |= {name for _, names in imported(path) for name in names}
    assert not named & forbidden
    assert not any("write" in name.lower() for name in named)
    called = {node.func.id for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    assert not called & {"eval", "exec", "vars"}, "a request could be made up"


def test_the_requests_that_are_sent_are_those_that_read():
    assert {kind.__name__ for kind in REQUESTS} == READS
    assert len(OTHERS) > 30


def test_the_link_offers_nothing_but_to_read():
    async def job():
        return BacnetLink(source_table("bacnet", interface="127.0.0.1"), lambda kind: None)

    link = asyncio.run(job())
    verbs = {name for name in dir(link) if not name.startswith("_")}
    assert verbs == {"open", "listen", "who_is", "find", "read_one", "read_list", "read", "subscribe", "close"}


@pytest.mark.parametrize("kind", OTHERS, ids=lambda kind: kind.__name__)
def test_no_other_request_gets_past_the_application_or_onto_the_wire(kind):
    async def job():
        sent = []
        stack = Stack(_address(free_udp_port()), 1.0, 0, lambda kind: None, foreign=False)

        async def wire(pdu):
            sent.append(pdu)

        stack.datagrams.indication = wire
        request = kind()
        request.pduDestination = _address(47808)
        with pytest.raises(NotReading, match="is not a request that reads"):
            stack.application.request(request)
        # Whatever is dug out of the library below the application: it is stopped where it would be encoded.
        generic = ConfirmedRequestPDU if issubclass(kind, ConfirmedRequestPDU) else UnconfirmedRequestPDU
        bare = generic(kind.service_choice, destination=_address(47808))
        with pytest.raises(NotReading, match="is not one that reads"):
            await stack.application.asap.request(bare)
        assert not sent

    asyncio.run(job())


def _address(port):
    from bacpypes3.pdu import IPv4Address

    return IPv4Address(f"127.0.0.1:{port}")


def test_a_verb_dug_out_of_the_library_does_not_reach_a_device():
    async def job():
        port = free_udp_port()
        peer = Peer(1201, port)
        air = peer.add()
        async with serving(peer):
            link = BacnetLink(source_table("bacnet", interface="127.0.0.1/8", port=port), lambda kind: None)
            await link.open()
            device = await link.find(1201, None)
            application = link._stack.application
            what = ObjectIdentifier(("analog-input", 1))
            with pytest.raises(NotReading):
                await application.write_property(device.address, what, "present-value", 5.0)
            request = WritePropertyRequest(
                objectIdentifier=what, propertyIdentifier=85, propertyValue=Real(5.0), destination=device.address
            )
            with pytest.raises(NotReading):
                await application.request(request)
            value = await link.read_one(device, Property(ObjectId(0, 1), 85))
            assert value.data == b"\x41\xac\x00\x00", "the link goes on"
            await link.close()
        assert air.presentValue == 21.5
        assert set(peer.asked) <= READS

    asyncio.run(job())


def test_others_can_neither_write_to_it_nor_silence_it():
    """What a stranger asks is refused, and it stays a client that reads."""

    async def job():
        port = free_udp_port()
        peer = Peer(1201, port)
        peer.add()
        async with serving(peer):
            link = BacnetLink(source_table("bacnet", interface="127.0.0.1/8", port=port), lambda kind: None)
            await link.open()
            device = await link.find(1201, None)
            me = _address(port)
            asking = LoopbackAsking(peer)
            for attempt in (
                asking.write(me),
                asking.read(me),
                asking.silence(me),
            ):
                assert str(await attempt) == "unrecognized-service"
            assert (await link.read_one(device, Property(ObjectId(0, 1), 85))).tag == 4
            await link.close()

    asyncio.run(job())


class LoopbackAsking:
    """A stranger's requests, sent by a peer."""

    def __init__(self, peer):
        self._peer = peer

    async def _refusal(self, request):
        from bacpypes3.apdu import RejectPDU

        try:
            await self._peer.request(request)
        except RejectPDU as refusal:
            return refusal.apduAbortRejectReason
        raise AssertionError("it was not refused")

    async def write(self, where):
        what = ObjectIdentifier(("device", 4194303))
        return await self._refusal(
            WritePropertyRequest(
                objectIdentifier=what, propertyIdentifier=77, propertyValue=Real(5.0), destination=where
            )
        )

    async def read(self, where):
        from bacpypes3.apdu import ReadPropertyRequest

        what = ObjectIdentifier(("device", 4194303))
        return await self._refusal(ReadPropertyRequest(objectIdentifier=what, propertyIdentifier=77, destination=where))

    async def silence(self, where):
        from bacpypes3.apdu import DeviceCommunicationControlRequest

        return await self._refusal(DeviceCommunicationControlRequest(enableDisable="disable", destination=where))
