"""Parquet files are read by the rules of CSV files."""

import asyncio
import shutil
import sys
from pathlib import Path

import pytest
from support.sources import played, recording

from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.reading import Fault

pd = pytest.importorskip("pandas")
pytest.importorskip("pyarrow")

CHANNELS = (
    {"id": "living/T_i", "column": "room", "valid": [-60, 80]},
    {"id": "living/u_heat", "columns": ["power", "more"], "unit": "kW"},
)
BERLIN = {"column": "when", "zone": "Europe/Berlin", "format": "%Y-%m-%d %H:%M"}
"""How the times are written."""


def readings(path, **layout):
    source = recording("recording", [path], CHANNELS, **layout)
    assert source.check() == []
    found = [reading for batch in played(source) for reading in batch.readings]
    return [(one.channel, repr(one.time), repr(one.value), one.fault) for one in found]


@pytest.fixture
def table(tmp_path):
    shutil.copy(Path(__file__).with_name("autumn.csv"), tmp_path / "a.csv")
    return pd.read_csv(tmp_path / "a.csv", sep=";", dtype=str, keep_default_na=False)


def test_texts_are_read_as_in_a_csv_file(table, tmp_path):
    table.to_parquet(tmp_path / "a.parquet")
    layout = {**BERLIN, "delimiter": ";", "decimal": ","}
    expected = readings(tmp_path / "a.csv", **layout)
    faults = {Fault.OUT_OF_RANGE, Fault.NON_NUMERIC, Fault.NOT_FINITE, Fault.BAD_TIMESTAMP}
    assert faults <= {one[3] for one in expected}
    assert readings(tmp_path / "a.parquet", **layout) == expected


@pytest.mark.parametrize("aware", [False, True])
def test_typed_columns_need_no_format(aware, table, tmp_path):
    typed = table.iloc[[0, 1, 3]].assign(room=[20.5, None, 999.0], power=[1.5, 1.0, None], more=[0.5, 0.0, 1.0])
    typed.to_csv(tmp_path / "b.csv", index=False)
    times = pd.to_datetime(typed["when"])
    typed["when"] = times.dt.tz_localize("Europe/Berlin", ambiguous=[True, True, True]) if aware else times
    typed.to_parquet(tmp_path / "b.parquet")
    own = {"column": "when"} if aware else {"column": "when", "zone": "Europe/Berlin"}
    assert readings(tmp_path / "b.parquet", **own) == readings(tmp_path / "b.csv", **BERLIN)


def test_other_types_are_numbers_where_they_are_any(tmp_path):
    frame = pd.DataFrame(
        {
            "when": [0, 900, 1800],
            "room": pd.array([20, None, 22], dtype="Int16"),
            "power": [True, False, True],
            "more": pd.to_datetime(["2025-01-01"] * 3),
        }
    )
    frame["when"] += 1_700_000_000
    frame.to_parquet(tmp_path / "c.parquet")
    found = readings(tmp_path / "c.parquet", column="when", format="epoch")
    assert [one[1:3] for one in found if one[0] == "living/T_i"] == [("1700000000.0", "20.0"), ("1700001800.0", "22.0")]
    assert {one[3] for one in found if one[0] == "living/u_heat"} == {Fault.NON_NUMERIC}


def test_what_cannot_be_read_is_a_sentence(table, tmp_path, monkeypatch):
    path = tmp_path / "a.parquet"
    table.drop(columns="power").to_parquet(path)
    source = recording("recording", [path], CHANNELS, **BERLIN)
    (problem,) = source.check()
    assert "has no column 'power' (channel living/u_heat); its columns are: when, room, more" in problem

    async def first():
        await anext(source.batches(None))

    with pytest.raises(SourceConfigError, match="has no column 'power'"):
        asyncio.run(first())
    path.write_bytes(b"PAR1 no parquet")
    with pytest.raises(SourceUnavailable, match=r"is no Parquet file .*; write it again"):
        asyncio.run(first())
    with pytest.raises(ValueError, match=r"a \.parquet file cannot"):
        recording("recording", [path], CHANNELS, follow=True, **BERLIN)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(SourceConfigError, match=r'needs pyarrow.*: pip install "thermogate\[parquet\]"'):
        asyncio.run(first())
