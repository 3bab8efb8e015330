"""Scanning Modbus units: reading only, bounded, in the operator's numbers."""

import asyncio
import struct

import pytest
from support.modbus_plant import READS, plant, serving, source

import adapters.modbus.scan
from adapters.errors import SourceConfigError
from adapters.scanning import Scan, Scannable


def scan(site, wanted, **keys):
    async def job():
        async with serving(site):
            bms = source(site.port, [], timeout=0.3, **keys)
            assert isinstance(bms, Scannable)
            return await bms.scan(wanted)

    return asyncio.run(job())


def cells(found):
    return [dict(zip(found.rows[0], row, strict=True)) for row in found.rows[1:]]


def test_registers_are_listed_with_what_they_might_be():
    high, low = struct.unpack(">2H", struct.pack(">f", 21.5))
    site = plant({1: [215, 0, 0, 0, high, low, low, high, 0xFFCB]})
    found = scan(site, Scan(registers=(1, 9), tables=("holding",)), first_register=1)
    rows = {row["register"]: row for row in cells(found)}
    assert rows["1"]["int16"] == "215"
    assert rows["1"]["hex"] == "0x00d7"
    assert "3" not in rows, "nothing between nothing"
    assert "float32 ABCD 21.5" in rows["5"]["might be"]
    assert "float32 CDAB 21.5" in rows["7"]["might be"]
    assert rows["9"]["int16"] == "-53"
    assert found.remarks == []
    assert site.codes == {3}


def test_every_table_and_unit_is_looked_at_and_silence_is_said():
    site = plant({1: [7], 2: [8], 3: [9]})
    site.silent.add(2)
    found = scan(site, Scan(devices=(1, 3), registers=(0, 0), tables=("holding",)))
    assert [(row["unit"], row["int16"]) for row in cells(found)] == [("1", "7"), ("3", "9")]
    assert found.remarks == ["unit 2: no answer within 0.3 s"]


def test_what_is_refused_is_narrowed_down():
    site = plant({1: list(range(100, 116))})
    site.refused |= {(1, "holding", 5), (1, "holding", 6)}
    found = scan(site, Scan(registers=(0, 15), tables=("holding",)))
    assert [row["register"] for row in cells(found)] == [str(k) for k in range(16) if k not in (5, 6)]
    assert {code for _, code, _, _ in site.asked} <= READS


def test_a_scan_is_bounded(monkeypatch):
    site = plant({1: [1]})
    with pytest.raises(SourceConfigError, match=r"bms: that is 51200 registers; a scan looks at 20000 at most"):
        scan(site, Scan(devices=(0, 255)))
    with pytest.raises(SourceConfigError, match="a unit id is at most 255"):
        scan(site, Scan(devices=(1, 300), registers=(0, 0)))
    with pytest.raises(SourceConfigError, match=r"the registers of this source are 1 to 65536"):
        scan(site, Scan(registers=(0, 5)), first_register=1)
    assert site.asked == []
    monkeypatch.setattr(adapters.modbus.scan, "MOST_REFUSALS", 5)
    found = scan(plant({1: [1]}), Scan(registers=(1000, 1999), tables=("holding",)))
    assert found.remarks == ["unit 1 holding: given up after 5 refused requests; narrow --registers"]


def test_a_table_that_is_not_there_says_why():
    found = scan(plant({1: [1]}), Scan(registers=(500, 500), tables=("holding",)))
    assert found.remarks == ["unit 1 holding: nothing there (exception 2 (illegal data address))"]
