"""Counters in recorded files, and what a probe of a recording shows."""

import asyncio

import pytest
from support.sources import recording

from adapters.errors import SourceUnavailable

METER = {"id": "z/u", "column": "E", "unit": "kWh", "to": "W"}


def source(tmp_path, *texts, **settings):
    files = []
    for number, text in enumerate(texts):
        files.append(tmp_path / f"{number}.csv")
        files[-1].write_text("t,E,T\n" + text)
    return recording("log", files, [METER, {"id": "z/T", "column": "T", "unit": "degC"}], format="epoch", **settings)


ROWS = "0,10,1\n900,10.5,1\n1800,10.5,1\n2700,,1\n3600,11.5,1\n"


async def test_a_start_in_the_middle_has_the_power_from_there_on(tmp_path):
    batches = [batch async for batch in source(tmp_path, ROWS).batches(900.0)]
    found = [(one.time, one.fault or one.value) for batch in batches for one in batch.readings if one.channel == "z/u"]
    assert found == [(900.0, 0.0), (1800.0, 2000.0)]


def test_a_probe_shows_the_first_and_the_last_row(tmp_path):
    probes = asyncio.run(source(tmp_path, ROWS, "4500,12,95\n").probe(1.0))
    assert [(probe.channel, probe.time, probe.value, probe.verdict) for probe in probes] == [
        ("z/u", 0.0, None, "good"),
        ("z/u", 4500.0, None, "good"),
        ("z/T", 0.0, 1.0, "good"),
        ("z/T", 4500.0, None, "out of range"),
    ]
    assert [probe.raw for probe in probes[:2]] == ["10", "12"]


def test_a_probe_of_a_file_without_rows_is_one_sentence(tmp_path):
    with pytest.raises(SourceUnavailable, match=r"sources.log: file '.*0.csv' has no rows; give one that has"):
        asyncio.run(source(tmp_path, "").probe(1.0))
