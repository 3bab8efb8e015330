"""BACnet cannot write: the link has no verb that does, and the wire would not carry it."""

import pytest

pytest.importorskip("bacpypes3", reason="bacpypes3 is not installed")

from bacpypes3.apdu import (
    ConfirmedRequestPDU,
    DeviceCommunicationControlRequest,
    ReadPropertyRequest,
    RejectPDU,
    UnconfirmedRequestPDU,
    WritePropertyRequest,
    confirmed_request_types,
    unconfirmed_request_types,
)
from bacpypes3.pdu import IPv4Address
from bacpypes3.primitivedata import ObjectIdentifier, Real
from support.bacnet_plant import READS, free_udp_port, one_device, serving
from support.sources import source_table

from adapters.bacnet.client import BacnetLink
from adapters.bacnet.objects import ObjectId
from adapters.bacnet.stack import REQUESTS, NotReading, ReadingApplication

REQUEST_TYPES = [*confirmed_request_types.values(), *unconfirmed_request_types.values()]
OTHERS = [kind for kind in REQUEST_TYPES if kind.__name__ not in READS]


def test_the_requests_that_are_sent_are_those_that_read():
    assert {kind.__name__ for kind in REQUESTS} == READS
    assert len(OTHERS) > 30


@pytest.mark.parametrize("kind", OTHERS, ids=lambda kind: kind.__name__)
async def test_no_other_request_gets_past_the_application_or_onto_the_wire(kind):
    sent = []
    network = source_table("bacnet", interface="127.0.0.1", port=free_udp_port())
    application = ReadingApplication(network, lambda kind: None)

    async def wire(pdu):
        sent.append(pdu)

    application.datagrams.indication = wire
    request = kind()
    request.pduDestination = IPv4Address("127.0.0.1:47808")
    with pytest.raises(NotReading, match="is not a request that reads"):
        application.request(request)
    # Whatever is dug out of the library below the application: it is stopped where it would be encoded.
    generic = ConfirmedRequestPDU if issubclass(kind, ConfirmedRequestPDU) else UnconfirmedRequestPDU
    bare = generic(kind.service_choice, destination=IPv4Address("127.0.0.1:47808"))
    with pytest.raises(NotReading, match="is not one that reads"):
        await application.asap.request(bare)
    assert not sent


async def test_others_can_neither_write_to_it_nor_silence_it():
    """What a stranger asks is refused, and it stays a client that reads."""
    port, peer = one_device()
    async with serving(peer):
        link = BacnetLink(source_table("bacnet", interface="127.0.0.1/8", port=port), lambda kind: None)
        await link.open()
        device = await link.find(1201, None)
        here = {"destination": IPv4Address(f"127.0.0.1:{port}")}
        named = {"objectIdentifier": ObjectIdentifier(("device", 4194303)), "propertyIdentifier": 77}
        for request in (
            WritePropertyRequest(**named, propertyValue=Real(5.0), **here),
            ReadPropertyRequest(**named, **here),
            DeviceCommunicationControlRequest(enableDisable="disable", **here),
        ):
            with pytest.raises(RejectPDU) as refused:
                await peer.request(request)
            assert str(refused.value.apduAbortRejectReason) == "unrecognized-service"
        assert await link.read_one(device, ObjectId(0, 1), 85) == 21.5
        await link.close()
