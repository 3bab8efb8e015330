"""Modbus cannot write: the client has no verb that does, and the wire would not carry it."""

import pytest
from pymodbus.exceptions import ModbusException
from support.modbus_plant import plant, serving
from support.sources import source_table
from support.tables import tabled

from adapters.modbus.client import ModbusLink

VERBS = {"read_coils", "read_discrete_inputs", "read_holding_registers", "read_input_registers"}


def line(**keys):
    return source_table("modbus", host="127.0.0.1", first_register=0, retries=0, **keys)


@pytest.mark.parametrize("transport", ["tcp", "rtu-over-tcp"])
async def test_the_client_offers_nothing_but_to_read(transport):
    link = ModbusLink(line(transport=transport))
    assert {name for name in dir(link) if not name.startswith("_")} == {"open", "read", "close"}
    assert {verb.__name__ for verb in link._reads.values()} == VERBS


@tabled
async def test_a_verb_dug_out_of_the_library_does_not_reach_the_wire(verb, arguments):
    async with serving(plant(holding=[7])) as site:
        link = ModbusLink(line(port=site.port))
        await link.open()
        library = link._reads["holding"].__self__
        with pytest.raises(ModbusException, match="is not one that reads"):
            await getattr(library, verb)(**arguments)
        assert (await link.read(1, "holding", 0, 1)).words == [7], "the connection goes on"
        await link.close()
        assert site.codes == {3}
