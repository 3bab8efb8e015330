"""The simulated BMS in a thread of the same process."""

from __future__ import annotations

import re
import socket
import threading
from pathlib import Path

import pytest
from pymodbus.client import ModbusTcpClient

from replay.bms.background import living_bms
from replay.bms.serving import BmsOptions
from replay.errors import ReplayError


def test_it_lives_while_the_block_runs(tmp_path: Path) -> None:
    options = BmsOptions(zones=2, port=0, control_port=0, zenoh=None, config=tmp_path / "bms.toml")
    with living_bms(options) as greeting:
        found = re.search(r"Modbus TCP +127\.0\.0\.1:(\d+)", "\n".join(greeting))
        assert found
        client = ModbusTcpClient("127.0.0.1", port=int(found[1]))
        assert client.connect()
        assert not client.read_input_registers(0, device_id=11).isError()
        client.close()
        assert f"port = {found[1]}" in (tmp_path / "bms.toml").read_text()
    assert not any(thread.name == "simulated-bms" for thread in threading.enumerate())
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", int(found[1])), timeout=5)


def test_a_start_that_fails_is_raised_where_it_was_asked_for() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(ReplayError, match=f"--port {port}"), living_bms(BmsOptions(port=port, control_port=0)):
            raise AssertionError("it has not begun")
