"""Modbus cannot write: the client has no verb that does, and the wire would not carry it."""

import pytest
from pymodbus.exceptions import ModbusException
from support.modbus_plant import READS, channel, collect, plant, serving, source
from support.sources import source_table

from adapters.modbus.client import ModbusLink, ReadingClient

VERBS = {"read_coils", "read_discrete_inputs", "read_holding_registers", "read_input_registers"}


def line(**keys):
    return source_table("modbus", host="127.0.0.1", first_register=0, retries=0, **keys)


@pytest.mark.parametrize("transport", ["tcp", "rtu-over-tcp"])
async def test_the_client_offers_nothing_but_to_read(transport):
    client = ReadingClient(line(transport=transport))
    assert {name for name in dir(client) if not name.startswith("_")} == {"connect", "connected", "close", "reads"}
    assert {verb.__name__ for verb in client.reads.values()} == VERBS


@pytest.mark.parametrize(
    ("verb", "arguments"),
    [
        ("write_coil", {"address": 0, "value": True}),
        ("write_register", {"address": 0, "value": 1}),
        ("write_coils", {"address": 0, "values": [True]}),
        ("write_registers", {"address": 0, "values": [1]}),
        ("mask_write_register", {"address": 0, "and_mask": 0, "or_mask": 1}),
        ("readwrite_registers", {"read_address": 0, "read_count": 1, "write_address": 0, "values": [1]}),
        ("diag_restart_communication", {"toggle": True}),
    ],
)
async def test_a_verb_dug_out_of_the_library_does_not_reach_the_wire(verb, arguments):
    async with serving(plant(holding=[7])) as site:
        link = ModbusLink(line(port=site.port))
        await link.open()
        library = link._client.reads["holding"].__self__
        with pytest.raises(ModbusException, match="is not one that reads"):
            await getattr(library, verb)(**arguments)
        assert (await link.read(1, "holding", 0, 1)).words == [7], "the connection goes on"
        await link.close()
        assert site.codes == {3}


async def test_what_a_device_sees_of_probe_and_of_polling():
    tables = {"coil": "bool", "discrete": "bool", "holding": "uint16", "input": "uint16"}
    channels = [channel(table, 0, kind, table=table) for table, kind in tables.items()]

    words = {table: [1] for table in tables}
    async with serving(plant(**words)) as site:
        bms = source(site.port, channels)
        assert {probe.verdict for probe in await bms.probe(1.0)} == {"good"}
        assert site.codes == READS
        site.codes.clear()
        await collect(bms, lambda batches: len(batches) >= 12)
        await bms.close()
        assert site.codes == READS
