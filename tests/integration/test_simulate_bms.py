"""`thermogate simulate-bms` as a process: it says where it is, serves, and stops when told to."""

from __future__ import annotations

import json
import logging
import signal
import socket
from collections.abc import Iterator

import pytest
import zenoh
from pymodbus.client import ModbusTcpClient
from support.bms_process import simulated
from support.harness import free_port
from support.waiting import wait_until

from service.cli.main import main


@pytest.fixture
def log() -> Iterator[None]:
    """The log's handlers as they were, after a command that set its own."""
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    yield
    root.handlers[:] = handlers
    root.setLevel(level)


@pytest.mark.parametrize("signum", [signal.SIGTERM, signal.SIGINT])
def test_it_stops_when_told_to_with_everyone_still_connected(signum: signal.Signals) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with simulated("--zenoh", endpoint, "--fault", "slow:room1,value=60") as bms:
        config = zenoh.Config()
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("listen/endpoints", "[]")
        config.insert_json5("scouting/multicast/enabled", "false")
        client = ModbusTcpClient("127.0.0.1", port=bms.port, timeout=5)
        assert client.connect()
        assert not client.read_holding_registers(100, count=2, device_id=12).isError()
        waiting = ModbusTcpClient("127.0.0.1", port=bms.port)
        assert waiting.connect()
        waiting.send(bytes.fromhex("0001 0000 0006 0b 04 0000 0001"))
        with zenoh.open(config) as session:
            subscriber = session.declare_subscriber("bms/json/room1/T_air")
            wait_until(subscriber.try_recv)
            bms.process.send_signal(signum)
            assert bms.process.wait(timeout=180) == 0
            subscriber.undeclare()
        client.close()
        waiting.close()


def test_faults_come_from_the_control_surface_while_it_runs() -> None:
    with simulated("--zenoh", "off", "--pace", 600) as bms:
        client = ModbusTcpClient("127.0.0.1", port=bms.port)
        assert client.connect()
        assert not client.read_input_registers(0, device_id=11).isError()
        bms.post("/faults", {"kind": "exception", "device": "room1", "value": 4, "for": "5min"})
        assert client.read_input_registers(0, device_id=11).exception_code == 4
        client.close()


@pytest.mark.usefixtures("log")
@pytest.mark.parametrize(
    ("arguments", "code", "gist"),
    [
        (["--pace", "9999"], 2, "'9999' is not a number from 0.01 to 3600"),
        (["--zenoh", "tcp/10.0.0.1:7448"], 2, "is not on a loopback address"),
        (["--set", "http.port=1"], 2, "--set changes the configuration that --write-config writes"),
        (["--fault", "slow:attic"], 1, 'there is no device "attic"'),
        (["--fault", "slow,for=soon"], 1, '--fault slow,for=soon: for: "soon" is not a duration'),
    ],
)
def test_mistakes_are_one_sentence(
    arguments: list[str], code: int, gist: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate-bms", "--port", "0", "--control-port", "0", *arguments]) == code
    said = capsys.readouterr().err
    assert gist in said
    assert len(said.splitlines()) == 1


@pytest.mark.usefixtures("log")
@pytest.mark.parametrize("option", ["--port", "--control-port"])
def test_a_taken_port_is_one_sentence(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        ports = {"--port": 0, "--control-port": 0} | {option: port}
        words = [str(word) for pair in ports.items() for word in pair]
        assert main(["simulate-bms", *words, "--zenoh", "off"]) == 1
    assert f"127.0.0.1:{port} cannot be used" in capsys.readouterr().err
