"""The OPC UA adapters against servers: asyncua's own, and node-opcua where it is installed."""

import asyncio
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import aclosing
from datetime import UTC, datetime, timedelta
from math import isnan
from pathlib import Path
from typing import Any
from unittest.mock import AsyncMock

import pytest
from support.certificates import Pair, make_pair
from support.processes import free_port
from support.sources import bound, source_table
from support.waiting import PATIENCE, wait_until

pytest.importorskip("asyncua", reason="asyncua is not installed")
from asyncua import Node, Server, ua
from asyncua.crypto.permission_rules import User, UserRole

import adapters.opcua.source
from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.reading import Fault, Quality
from adapters.scanning import Scan

BEGIN = 1_767_225_600.0
"""UTC s at which the recorded history begins."""
SECRET = "test-only"


class Users:
    """Lets everybody in who gives no name, and one who has a password."""

    def get_user(self, iserver: Any, username: Any = None, password: Any = None, certificate: Any = None) -> Any:
        return User(role=UserRole.User) if username is None or password == SECRET else None


class Plant:
    """A server in a thread of its own, on loopback. `T`, `power` and the others are what it has to offer."""

    def __init__(self, folder: Path) -> None:
        self.own = make_pair(folder, "server", kind="rsa", uri="urn:plant")
        self.client = make_pair(folder, "client", kind="rsa", uri="urn:thermogate:test")
        self.loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self._thread.start()
        self.do(self._start())

    def do(self, work: Any) -> Any:
        """What `work` brings in the thread of the server."""
        return asyncio.run_coroutine_threadsafe(work, self.loop).result(PATIENCE)

    def stop(self) -> None:
        """Stop the server and its thread."""

        async def ended() -> None:
            await self.server.stop()
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)

        self.do(ended())
        self.loop.call_soon_threadsafe(self.loop.stop)
        self._thread.join(PATIENCE)
        self.loop.close()

    async def _start(self) -> None:
        self.server = server = Server(user_manager=Users())
        await server.init()
        server.set_endpoint("opc.tcp://127.0.0.1:0/")
        await server.set_application_uri("urn:plant")
        await server.load_certificate(self.own.certificate)
        await server.load_private_key(self.own.private_key, format="pem")
        policies = ["NoSecurity", "Basic256Sha256_Sign", "Basic256Sha256_SignAndEncrypt"]
        server.set_security_policy([ua.SecurityPolicyType[name] for name in policies])
        assert await server.register_namespace("urn:building") == 2
        room = await server.nodes.objects.add_object(2, "Room")
        values = {"T": 21.5, "switch": True, "name": "living", "meter": 100, "nothing": 0.0}
        self.nodes: dict[str, Node] = {
            name: await room.add_variable(ua.NodeId(name, 2), name, value) for name, value in values.items()
        }
        unit = ua.EUInformation(DisplayName=ua.LocalizedText("°C"))
        await self.nodes["T"].add_property(0, "EngineeringUnits", unit)
        # What servers have where nobody has entered a unit, or does not give away.
        await self.nodes["switch"].add_property(0, "EngineeringUnits", ua.EUInformation())
        await self.nodes["meter"].add_property(0, "EngineeringUnits", ua.Variant(None, ua.VariantType.Null))
        secret = await self.nodes["nothing"].add_property(0, "EngineeringUnits", unit)
        await secret.write_value(ua.DataValue(ua.Variant(unit), ua.StatusCode(ua.StatusCodes.BadUserAccessDenied)))
        await server.start()
        self.port = server.bserver._server.sockets[0].getsockname()[1]

    def set(self, name: str, value: Any, status: str = "Good", ahead: float = 0.0) -> float:
        """Give a node a value whose source dates it `ahead` s from now; that time, UTC s."""
        when = datetime.now(UTC) + timedelta(seconds=ahead)
        code = ua.StatusCode(getattr(ua.StatusCodes, status))
        self.do(self.nodes[name].write_value(ua.DataValue(ua.Variant(value), code, when, when)))
        return when.timestamp()

    def drop(self) -> None:
        """Close every connection."""

        async def closed() -> None:
            for client in list(self.server.bserver.clients):
                client.transport.close()

        self.do(closed())


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    running = Plant(tmp_path_factory.mktemp("opcua"))
    yield running
    running.stop()


def source(port: int, channels: list[dict[str, Any]], kind: str = "opcua", **keys: Any) -> Any:
    table = source_table(kind, url=f"opc.tcp://127.0.0.1:{port}", **{"timeout": 20} | keys)
    return table.build("bms", [bound(table, **{"unit": "degC"} | channel) for channel in channels])


def node(name: str, **keys: Any) -> dict[str, Any]:
    return {"id": f"z/{name}", "node": f"ns=2;s={name}"} | keys


async def test_a_probe_says_what_is_there(plant: Plant) -> None:
    plant.set("T", 21.5)
    plant.set("meter", 100)
    plant.set("nothing", 0.0, "BadWaitingForInitialData")
    channels = [
        node("T", node="nsu=urn:building;s=T"),
        node("switch", unit="%", nominal=1000, to="W", scale=100),
        node("meter", unit="kWh", to="W"),
        node("name"),
        node("nothing"),
        node("other"),
        node("elsewhere", node="nsu=urn:elsewhere;s=T"),
    ]
    probes = {one.channel: one for one in await source(plant.port, channels).probe(1.0)}
    assert probes["z/T"][1:4] == ("nsu=urn:building;s=T", "21.5", 21.5)
    assert probes["z/T"].hints == ("the server states its unit as °C",)
    assert probes["z/switch"].value == 1000.0
    assert not probes["z/switch"].hints
    assert probes["z/meter"].hints == ("the counter stands at 100",)
    assert "is no number but a str" in probes["z/name"].verdict
    assert probes["z/nothing"].verdict.startswith("not available")
    for name in ("z/other", "z/elsewhere"):
        assert "the server refuses it: BadNodeIdUnknown; check node" in probes[name].verdict


async def test_a_scan_lists_the_numbers_of_a_server(plant: Plant) -> None:
    plant.set("T", 21.5)
    found = await source(plant.port, []).scan(Scan())
    assert ("ns=2;s=T", "Room/T", "21.5", "°C", "Good") in found.rows
    assert ("ns=2;s=switch", "Room/switch", "1", "-", "Good") in found.rows
    assert not [row for row in found.rows if row[1] == "Room/name"]
    assert not found.remarks


@pytest.mark.parametrize("subscribe", [True, False], ids=["subscribed", "polled"])
async def test_values_come_with_their_time_and_status(
    plant: Plant, subscribe: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What is subscribed to is read once, and never after that.
    monkeypatch.setattr(adapters.opcua.source, "CONFIRM", PATIENCE)
    plant.set("T", 20.0)
    bms = source(plant.port, [node("T"), node("other")], poll=0.1, subscribe=subscribe)
    async with asyncio.timeout(PATIENCE), aclosing(bms.batches(None)) as stream:
        began = time.time()
        first = await anext(stream)
        assert {one.channel: one.fault for one in first.readings} == {"z/T": None, "z/other": Fault.REFUSED_BY_DEVICE}

        async def until(value: float | None, *marks: object) -> Any:
            """The first reading with the value or one of the marks; those before have what there was."""
            async for batch in stream:
                (one,) = (reading for reading in batch.readings if reading.channel == "z/T")
                assert began <= one.time <= batch.now
                if one.value == value or one.fault in marks or one.quality in marks:
                    return one
            raise AssertionError

        when = plant.set("T", 21.0)
        changed = await until(21.0)
        # A notification may come after a poll at which the earlier value still counted.
        assert changed.time == pytest.approx(when, abs=PATIENCE if subscribe else 0.001)
        assert (await until(21.0)).time > changed.time, "a value that stays the same counts at every poll"
        plant.set("T", 22.0, ahead=3600.0)
        await until(22.0)
        plant.set("T", 23.0, "UncertainSensorCalibration")
        assert (await until(None, Quality.UNCERTAIN)).value == 23.0
        plant.set("T", 24.0, "BadSensorFailure")
        assert isnan((await until(None, Fault.REPORTED_BAD)).value)
        plant.set("T", 25.0, "BadNoData")
        await until(None, Fault.NOT_AVAILABLE)
        plant.set("T", 25.0)
        await until(25.0)


async def test_a_lost_connection_is_taken_up_again(plant: Plant) -> None:
    bms = source(plant.port, [node("T")], poll=0.05)
    plant.set("T", 21.5)

    async def read_until_it_is_lost() -> None:
        async for batch in bms.batches(None):
            assert [one.value for one in batch.readings] == [21.5]
            plant.drop()

    for _ in range(2):
        with pytest.raises(SourceUnavailable, match=r"sources\.bms: opc\.tcp://127\.0\.0\.1:\d+ "):
            await read_until_it_is_lost()


async def test_other_channels_are_taken_up_over_the_same_session(plant: Plant) -> None:
    plant.set("T", 21.5)
    bms = source(plant.port, [node("T")], poll=0.05)
    table = source_table("opcua", url="opc.tcp://other")
    async with asyncio.timeout(PATIENCE), aclosing(bms.batches(None)) as stream:
        assert [one.channel for one in (await anext(stream)).readings] == ["z/T"]
        assert (before := list(plant.server.bserver.clients))
        bms.rebind([bound(table, **node("switch"), unit="1")])
        assert [(one.channel, one.value) for one in (await anext(stream)).readings] == [("z/switch", 1.0)]
        assert plant.server.bserver.clients == before


def security(ours: Pair, server: Pair, **keys: Any) -> dict[str, Any]:
    files = {"certificate": ours.certificate, "private_key": ours.private_key}
    return files | {"server_certificate": server.certificate} | keys


@pytest.mark.parametrize("mode", ["sign", "encrypt"])
async def test_a_secured_session_with_a_login(plant: Plant, mode: str, tmp_path: Path) -> None:
    (tmp_path / "password").write_text(SECRET + "\n")
    login = {"user": "reader", "password_file": str(tmp_path / "password")}
    plant.set("T", 21.5)
    secured = security(plant.client, plant.own, mode=mode)
    (probe,) = await source(plant.port, [node("T")], security=secured, **login).probe(1.0)
    assert probe.value == 21.5
    (tmp_path / "password").write_text("wrong")
    with pytest.raises(SourceUnavailable, match="check user and password"):
        await source(plant.port, [node("T")], security=secured, **login).probe(1.0)


async def test_no_other_server_is_trusted(plant: Plant, tmp_path: Path) -> None:
    other = make_pair(tmp_path, "other", kind="rsa", uri="urn:plant")
    bms = source(plant.port, [node("T")], security=security(plant.client, other), timeout=3)
    with pytest.raises(SourceUnavailable, match=r"sources\.bms: opc.*check url.*security"):
        await bms.probe(1.0)


def test_files_that_cannot_be_used_are_named(tmp_path: Path, plant: Plant) -> None:
    nameless = make_pair(tmp_path, "nameless", kind="rsa")
    (tmp_path / "text.pem").write_text("no certificate")
    text = plant.own._replace(certificate=tmp_path / "text.pem")

    def said(ours: Pair, server: Pair) -> str:
        (sentence,) = source(1, [], security=security(ours, server)).check()
        return str(sentence)

    assert f"security.certificate: {nameless.certificate} names no application" in said(nameless, plant.own)
    assert "text.pem holds no certificate in PEM or DER" in said(plant.client, text)
    other = plant.client._replace(private_key=nameless.private_key)
    assert "nameless.key is not the unlocked RSA key" in said(other, plant.own)
    assert source(1, [], security=security(plant.client, plant.own)).check() == []


def record(plant: Plant, name: str, values: list[tuple[float, float, str]]) -> None:
    """Put values into the history of a node: minutes since BEGIN, value and status."""
    storage = plant.server.iserver.history_manager.storage
    id = plant.nodes[name].nodeid

    async def saved() -> None:
        await storage.new_historized_node(id, timedelta(days=36500), 0)
        for minute, value, status in values:
            stamp = datetime.fromtimestamp(BEGIN + 60 * minute, UTC)
            code = ua.StatusCode(getattr(ua.StatusCodes, status))
            await storage.save_node_value(id, ua.DataValue(ua.Variant(value), code, stamp, stamp))

    plant.do(saved())


def past(port: int, place: str, **keys: Any) -> Any:
    begin, end = (datetime.fromtimestamp(BEGIN + 60 * minute, UTC).isoformat() for minute in (0, 60))
    return source(port, [node("T", node=place)], "opcua-history", begin=begin, end=end, step=600, **keys)


async def history(archive: Any) -> dict[float, float]:
    """Values by minutes since BEGIN."""
    found = {}
    async with aclosing(archive.batches(None)) as stream:
        async for batch in stream:
            found |= {(one.time - BEGIN) / 60: one.value for one in batch.readings}
    await archive.close()
    return found


async def test_history_is_what_held_at_every_step(plant: Plant) -> None:
    values = [(-5, 19.0, "Good"), (4, 20.0, "Good"), (10, 21.0, "Good"), (19, 22.0, "BadSensorFailure")]
    record(plant, "T", [*values, (30, 23.0, "UncertainLastUsableValue")])
    assert await history(past(plant.port, "ns=2;s=T")) == {0: 19.0, 10: 21.0, 30: 23.0, 40: 23.0, 50: 23.0}
    assert await history(past(plant.port, "ns=2;s=T", hold="12min")) == {0: 19.0, 10: 21.0, 30: 23.0, 40: 23.0}
    (probe,) = await (archive := past(plant.port, "ns=2;s=T")).probe(1.0)
    await archive.close()
    assert probe.value == 23.0


async def test_a_session_that_fails_at_once_is_ended(plant: Plant, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("asyncua.Client.get_namespace_array", AsyncMock(side_effect=ua.UaError("not now")))
    with pytest.raises(SourceUnavailable, match="not now"):
        await history(past(plant.port, "ns=2;s=T"))
    await asyncio.to_thread(wait_until, lambda: not plant.server.bserver.clients)


FOREIGN = Path(__file__).parents[3] / ".venv" / "node-opcua" / "node_modules"


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """The port of a server of node-opcua."""
    if not FOREIGN.exists():
        pytest.skip("node-opcua is not installed here (make .venv/node-opcua)")
    port, script = free_port(), Path(__file__).with_name("foreign.js")
    command = ["node", str(script), str(port), str(tmp_path_factory.mktemp("pki"))]
    with subprocess.Popen(
        command, env={"NODE_PATH": str(FOREIGN), "PATH": "/usr/bin:/bin"}, stdout=-1, stderr=-3
    ) as it:
        assert it.stdout is not None
        assert any(line.startswith(b'{"space"') for line in it.stdout), "it ended"
        yield port
        it.kill()


async def test_a_foreign_server_is_read_in_every_way(foreign: int) -> None:
    T, broken = ({"id": f"z/{name}", "node": f"ns=1;s={name}"} for name in ("T", "broken"))
    bms = source(foreign, [T, broken], poll=0.2)
    assert ("ns=1;s=T", "Room/T") in [row[:2] for row in (await bms.scan(Scan())).rows]
    good, bad = await bms.probe(1.0)
    assert good.verdict == "good"
    assert good.hints == ("the server states its unit as °C",)
    assert bad.verdict == "reported bad: its status is BadSensorFailure"
    seen: set[float] = set()
    async with asyncio.timeout(PATIENCE), aclosing(bms.batches(None)) as stream:
        async for batch in stream:
            assert {one.channel: one.fault for one in batch.readings} == {"z/T": None, "z/broken": Fault.REPORTED_BAD}
            seen |= {one.value for one in batch.readings if one.fault is None}
            if len(seen) > 2:
                break
    assert await history(past(foreign, T["node"])) == {0: 20.0, 10: 21.0, 20: 22.0, 30: 22.9, 40: 22.9, 50: 22.9}
    for place, said in ((broken["node"], "gives no history of ns=1;s=broken"), ("nsu=urn:other;i=1", "the namespace")):
        archive = past(foreign, place)
        with pytest.raises(SourceConfigError, match=rf"sources\.bms: .* {said}"):
            await history(archive)
        await archive.close()
