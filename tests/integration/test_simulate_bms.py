"""`thermogate simulate-bms` as a process: it says where it is, serves, and stops when told to."""

from __future__ import annotations

import signal
import socket

import pytest
from pymodbus.client import ModbusTcpClient
from support.bms_process import Bms
from support.harness import thermogate
from support.waiting import wait_until
from support.zenoh_plant import endpoint, session


def test_it_serves_and_breaks_and_stops_with_everyone_still_connected() -> None:
    place = endpoint()
    with Bms("--zenoh", place, "--pace", 600, "--fault", "slow:room1,value=60") as bms:
        client = ModbusTcpClient("127.0.0.1", port=bms.port, timeout=5)
        assert client.connect()
        assert not client.read_holding_registers(100, count=2, device_id=12).isError()
        bms.break_down("exception", "room2", value=4, **{"for": "5min"})
        assert client.read_holding_registers(100, count=2, device_id=12).exception_code == 4
        waiting = ModbusTcpClient("127.0.0.1", port=bms.port)
        assert waiting.connect()
        waiting.send(bytes.fromhex("0001 0000 0006 0b 04 0000 0001"))
        with session(connect=place) as listening:
            subscriber = listening.declare_subscriber("bms/json/room1/T_air")
            wait_until(subscriber.try_recv)
            assert bms.terminate(signal.SIGINT) == 0
            subscriber.undeclare()
        client.close()
        waiting.close()


TAKEN = "PORT"
"""Stands for a port that somebody else has."""


@pytest.mark.usefixtures("restored")
@pytest.mark.parametrize(
    ("arguments", "code", "gist"),
    [
        (["--fault", "slow:attic"], 1, 'there is no device "attic"'),
        (["--fault", "slow,for=soon"], 1, '--fault slow,for=soon: for: "soon" is not a duration'),
        (["--port", TAKEN, "--zenoh", "off"], 1, "127.0.0.1:PORT cannot be used"),
        (["--control-port", TAKEN, "--zenoh", "off"], 1, "127.0.0.1:PORT cannot be used"),
    ],
)
def test_mistakes_are_one_sentence(arguments: list[str], code: int, gist: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = str(other.getsockname()[1])
        words = [port if word == TAKEN else word for word in arguments]
        done = thermogate("simulate-bms", "--port", "0", "--control-port", "0", *words)
    assert done.returncode == code
    assert gist.replace(TAKEN, port) in done.stderr
    if TAKEN not in arguments:
        assert len(done.stderr.splitlines()) == 1
