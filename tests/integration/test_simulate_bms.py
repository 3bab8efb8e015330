"""`thermogate simulate-bms` as a process: it says where it is, serves, and stops when told to."""

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


@pytest.mark.usefixtures("restored")
@pytest.mark.parametrize("option", ["--port", "--control-port"])
def test_a_port_that_is_taken_is_one_sentence(option: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = str(other.getsockname()[1])
        free = {"--port": "0", "--control-port": "0"} | {option: port}
        done = thermogate("simulate-bms", "--zenoh", "off", *(word for pair in free.items() for word in pair))
    assert done.returncode == 1
    assert f"127.0.0.1:{port} cannot be used" in done.stderr
