"""No code of a bus that only reads names a verb that writes, or could make one up."""

import ast
import re
from pathlib import Path

import pytest
from pymodbus.client.mixin import ModbusClientMixin

ROOT = Path(__file__).parents[2]
ADAPTERS = ROOT / "adapters"

KNOWING = {
    "asyncua": {"opcua/client.py"},
    "pymodbus": {"modbus/client.py"},
    "bacpypes3": {"bacnet/client.py", "bacnet/stack.py"},
}


def others(kind):
    """What the library of a bus can ask for beside reading."""
    if kind == "modbus":
        reads = {"read_coils", "read_discrete_inputs", "read_holding_registers", "read_input_registers"}
        return {name for name in vars(ModbusClientMixin) if not name.startswith("__")} - reads
    if kind == "opcua":
        pytest.importorskip("asyncua", reason="asyncua is not installed")
        from asyncua import Client, Node
        from asyncua.client.ua_session import UaSession

        reads = ("read", "get", "browse", "translate", "subscribe", "connect", "history_read", "create_subscription")
        more = {"delete", "disconnect", "set_user", "set_password", "set_security"}
        verbs = {name for one in (Client, Node, UaSession) for name, verb in vars(one).items() if callable(verb)}
        return {name for name in verbs if not name.startswith(("_", *reads))} - more
    pytest.importorskip("bacpypes3", reason="bacpypes3 is not installed")
    from bacpypes3.apdu import confirmed_request_types, unconfirmed_request_types
    from support.bacnet_plant import READS

    requests = {kind.__name__ for kind in (*confirmed_request_types.values(), *unconfirmed_request_types.values())}
    return requests - READS - {"IAmRequest", "UnconfirmedCOVNotificationRequest"}


def names(tree):
    """Every name that a module uses, imports, calls as an attribute, or writes as a text."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.ImportFrom | ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def test_few_modules_know_the_library_of_a_bus():
    # The simulated building is devices, and devices may know everything.
    paths = [
        path
        for package in ("adapters", "service", "replay", "thermogate")
        for path in sorted((ROOT / package).rglob("*.py"))
        if ROOT / "replay" / "bms" not in path.parents
    ]
    assert len(paths) > 100
    texts = {path: path.read_text(encoding="utf-8") for path in paths}
    for library, expected in KNOWING.items():
        imports = re.compile(rf"^\s*(?:from|import) .*\b{library}\b", re.MULTILINE)
        knowing = {path.relative_to(ADAPTERS).as_posix() for path, text in texts.items() if imports.search(text)}
        assert knowing == expected


@pytest.mark.parametrize(
    "path",
    [path for kind in ("modbus", "bacnet", "opcua") for path in sorted((ADAPTERS / kind).glob("*.py"))],
    ids=lambda path: path.stem,
)
def test_no_module_names_a_verb_that_writes(path):
    forbidden, tree = others(path.parent.name), ast.parse(path.read_text(encoding="utf-8"))
    assert forbidden & {"write_register", "WritePropertyRequest", "write_value"}
    named = {name for name in names(tree) if name.isidentifier()}
    assert not named & forbidden
    assert not any("write" in name.lower() for name in named)
    called = {node.func.id for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    assert not called & {"eval", "exec", "vars"}, "a verb could be made up"
    assert path.parent.name == "bacnet" or "getattr" not in called
