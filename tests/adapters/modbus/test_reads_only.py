"""Modbus cannot write: no code names a verb that does, the client has none, and the wire would not carry it."""

import ast
import asyncio
from pathlib import Path

import pytest
from pymodbus.client.mixin import ModbusClientMixin
from pymodbus.exceptions import ModbusException
from support.modbus_plant import READS, channel, collect, plant, serving, source
from support.sources import source_table

from adapters.modbus.client import ModbusLink, ReadingClient

ROOT = Path(__file__).parents[3]
VERBS = {"read_coils", "read_discrete_inputs", "read_holding_registers", "read_input_registers"}
OTHER_VERBS = {name for name in vars(ModbusClientMixin) if not name.startswith("__")} - VERBS
"""Everything else that pymodbus can ask of a device."""

# The simulated building is a device, and devices are written to.
MODULES = [
    path
    for package in ("adapters", "service", "replay", "thermogate")
    for path in sorted((ROOT / package).rglob("*.py"))
    if ROOT / "replay" / "bms" not in path.parents
]


def names(tree):
    """Every name that a module imports, calls as an attribute, or writes as a text."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.ImportFrom | ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def test_one_module_knows_pymodbus():
    assert len(MODULES) > 100
    knowing = [
        path
        for path in MODULES
        if any(
            (node.module or "").startswith("pymodbus")
            if isinstance(node, ast.ImportFrom)
            else isinstance(node, ast.Import) and any(alias.name.startswith("pymodbus") for alias in node.names)
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        )
    ]
    assert knowing == [ROOT / "adapters" / "modbus" / "client.py"]


@pytest.mark.parametrize("path", sorted((ROOT / "adapters" / "modbus").glob("*.py")), ids=lambda path: path.name)
def test_no_module_of_the_adapter_names_a_verb_that_writes(path):
    assert {"write_register", "write_coils", "mask_write_register", "readwrite_registers", "execute"} <= OTHER_VERBS
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert not {*names(tree)} & OTHER_VERBS
    assert not any("write" in name.lower() for name in names(tree) if name.isidentifier())
    called = {node.func.id for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    assert not called & {"getattr", "eval", "exec", "vars"}, "a verb could be made up"
    if path.name == "modbus_client.py":
        assert {*names(tree)} >= VERBS
        imported = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}
        # Of the requests themselves only their base class is at hand.
        assert {name for name in imported if name.startswith("pymodbus.pdu")} == {"pymodbus.pdu"}


def line(**keys):
    return source_table("modbus", host="127.0.0.1", first_register=0, retries=0, **keys)


@pytest.mark.parametrize("transport", ["tcp", "rtu-over-tcp"])
def test_the_client_offers_nothing_but_to_read(transport):
    async def job():
        return ReadingClient(line(transport=transport))

    client = asyncio.run(job())
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
def test_a_verb_dug_out_of_the_library_does_not_reach_the_wire(verb, arguments):
    async def job():
        async with serving(plant(holding=[7])) as site:
            link = ModbusLink(line(port=site.port))
            await link.open()
            library = link._client.reads["holding"].__self__
            with pytest.raises(ModbusException, match="is not one that reads"):
                await getattr(library, verb)(**arguments)
            assert (await link.read(1, "holding", 0, 1)).words == [7], "the connection goes on"
            link.close()
            assert site.codes == {3}

    asyncio.run(job())


def test_what_a_device_sees_of_probe_and_of_polling():
    tables = {"coil": "bool", "discrete": "bool", "holding": "uint16", "input": "uint16"}
    channels = [channel(table, 0, kind, table=table) for table, kind in tables.items()]

    async def job():
        words = {table: [1] for table in tables}
        async with serving(plant(**words)) as site:
            bms = source(site.port, channels)
            assert {probe.verdict for probe in await bms.probe(1.0)} == {"good"}
            assert site.codes == READS
            site.codes.clear()
            await collect(bms, lambda batches: len(batches) >= 12)
            await bms.close()
            assert site.codes == READS

    asyncio.run(job())
