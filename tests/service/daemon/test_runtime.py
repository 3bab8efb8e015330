"""Zones and sources as the daemon starts, stops and starts them again, without the process around them."""

import asyncio
from datetime import timedelta

import pytest
from support.config_samples import HEADER, sound, write
from support.running_zone import plumbing
from support.waiting import until

from adapters.fields.times import parse_time, utc
from service.config.load import load
from service.daemon.runtime import Runtime
from service.daemon.zone_table import Zones

FIRST = parse_time("2025-05-03T00:00:00Z")


def configured(folder):
    """The living room of the sound configuration; it bridges three samples without a reading."""
    tables = sound(folder)
    del tables["zones"][1]
    tables["sources"]["log"]["timestamp"]["zone"] = "UTC"
    tables["zones"][0] |= {"max_gap": 3, "hold_inputs": "10min", "estimator_options": {"particles": 50}}
    return load(write(folder, tables))


def record(folder, rows, silent):
    """The recording, a row every 5 min; those in `silent` have a time and nothing else."""
    lines = [HEADER]
    for row in rows:
        when = FIRST + timedelta(minutes=5 * row)
        lines.append(f"{when:%Y-%m-%d %H:%M:%S}," + (",,,," if row in silent else f"{20 + row / 10},19,5,0.4,0.2,0"))
    (folder / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


async def lived(config, state):
    """Every sample that the journal holds after the zones have taken in the recording and were stopped."""
    async with plumbing(state) as shared:
        runtime = Runtime(config, Zones(), shared)
        await runtime.restore()
        runtime.start_zones()
        await runtime.start_feeds()
        await until(lambda: all(feed.over for feed in runtime.feeds))
        await runtime.stop_feeds()
        await runtime.drain()
        samples = await shared.store.samples_after("living", None)
    return [f"{utc(sample.time):%H:%M} {sample.outputs} {sample.inputs}" for sample in samples]


@pytest.mark.parametrize("stop", [3, 5, 6, 9, 13])
def test_a_restart_in_a_gap_goes_on_as_if_it_had_never_stopped(stop, tmp_path):
    config, silent = configured(tmp_path), range(4, 14)
    record(tmp_path, range(20), silent)
    uninterrupted = asyncio.run(lived(config, tmp_path / "never"))
    assert sum("nan" in sample for sample in uninterrupted) == 4, "then the grid falls silent"
    record(tmp_path, range(stop), silent)
    asyncio.run(lived(config, tmp_path / "twice"))
    record(tmp_path, range(20), silent)
    assert asyncio.run(lived(config, tmp_path / "twice")) == uninterrupted
