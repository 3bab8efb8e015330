"""The bytes on a serial line against those that the specification prints."""

import os
import select
import threading
import tty

import pytest
from support.modbus_plant import channel, source
from support.sources import collect

from adapters.errors import SourceConfigError, SourceUnavailable

pytest.importorskip("serial", reason="pyserial is not installed")

# Read holding registers 107 to 109 of unit 17: the frames as textbooks on the protocol print them.
REQUEST = bytes.fromhex("11 03 00 6B 00 03 76 87")
RESPONSE = bytes.fromhex("11 03 06 AE 41 56 52 43 40 49 AD")


def meter(device, parity="none"):
    channels = [channel(f"c{k}", 107 + k, "uint16", unit_id=17) for k in range(3)]
    line = {"device": device, "baudrate": 9600, "parity": parity}
    return source(502, channels, transport="rtu", host=None, serial=line, timeout=0.5)


@pytest.fixture
def line():
    """The two ends of a pseudo-terminal."""
    controller, device = os.openpty()
    tty.setraw(device)
    yield controller, os.ttyname(device)
    os.close(controller)
    os.close(device)


async def test_a_serial_line_carries_the_frames_of_the_specification(line):
    controller, device = line
    received = []

    def answer():
        if select.select([controller], [], [], 10)[0]:
            received.append(os.read(controller, 64))
            os.write(controller, RESPONSE)

    thread = threading.Thread(target=answer)
    thread.start()
    (batch,) = await collect(meter(device))
    assert [reading.value for reading in batch.readings] == [0xAE41, 0x5652, 0x4340]
    thread.join()
    assert received == [REQUEST]


async def test_a_port_that_is_not_there_or_does_not_know_the_settings_is_one_sentence(line):
    with pytest.raises(SourceUnavailable, match=r"sources.bms: .*/dev/no-such-port.* check the cable, the name of the"):
        await collect(meter("/dev/no-such-port"))
    # A pseudo-terminal has no parity.
    with pytest.raises(SourceUnavailable, match="cannot be opened"):
        await collect(meter(line[1], "even"))


async def test_a_missing_serial_library_is_said_before_anything_is_opened(monkeypatch):
    monkeypatch.setattr("adapters.modbus.source.find_spec", lambda name: None)
    bms = meter("/dev/ttyUSB0")
    assert bms.check() == [
        "sources.bms: a serial port needs pyserial; install it with: pip install 'thermogate[serial]'"
    ]
    with pytest.raises(SourceConfigError, match="needs pyserial"):
        await collect(bms)
