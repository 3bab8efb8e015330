"""From a recorded file through source, router and alignment to samples."""

import asyncio
import csv
from datetime import UTC, datetime

import pytest
from support.sources import recording as recorded

from adapters.routing import Router
from estimator.network.presets import network
from service.zone.alignment import Alignment, Rules


def samples(recording, channels, alignment, start=None):
    async def run():
        router = Router(recording.name, [channel["id"] for channel in channels])
        closed = []
        async for batch in recording.batches(start):
            for delivery in router.split(batch):
                closed += alignment.add(delivery.source, delivery.readings, delivery.now)
        return closed + alignment.end(recording.name)

    return asyncio.run(run())


ECOLAR_COLUMNS = {
    "T_air": ("Temp2",),
    "T_out": ("Sensor_outside",),
    "T_adj": ("Other_room_temp",),
    "u_heat": ("my-pv1", "my-pv2", "my-pv3", "Relay 4", "Relay 5"),
}


@pytest.fixture
def ecolar_day(tmp_path):
    """The day of the autumn clock change in the raw Ecolar layout, a row every 10 s; values tell the UTC time."""
    begin = int(datetime(2025, 10, 25, 22, tzinfo=UTC).timestamp())
    path = tmp_path / "ecolar.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["Timestamp", *(column for columns in ECOLAR_COLUMNS.values() for column in columns)])
        for elapsed in range(0, 25 * 3600, 10):
            # Konstanz leaves summer time at 01:00 UTC, three hours after this local midnight.
            local = datetime.fromtimestamp(begin + elapsed + (7200 if elapsed < 3 * 3600 else 3600), UTC)
            row = [20 + elapsed / 1e5, 5, 18, elapsed % 600 / 1000, 0.25, 0, 0, 0]
            writer.writerow([f"{local:%Y-%m-%d %H:%M:%S}", *row])
    return path, begin


def ecolar(path, **settings):
    zone = network("ecolar-6r4c")
    channels = [
        {"id": f"living/{channel}", "columns": columns, "unit": given, "to": unit}
        for channel, columns in ECOLAR_COLUMNS.items()
        for unit, given in [(zone.channel_unit(channel), "kW" if channel == "u_heat" else "degC")]
    ]
    recording = recorded("raw", [path], channels, "Timestamp", zone="Europe/Berlin")
    return recording, channels, Alignment(zone, 300, ["raw"], Rules(zone="living", **settings))


def test_the_raw_ecolar_layout_over_the_clock_change(ecolar_day):
    path, begin = ecolar_day
    recording, channels, alignment = ecolar(path)
    got = samples(recording, channels, alignment)
    assert not alignment.faults
    assert [sample.time for sample in got] == [begin + 300 * k for k in range(25 * 12)]
    for k, sample in enumerate(got):
        assert sample.outputs[0] == pytest.approx(20 + (300 * k + 145) / 1e5, abs=1e-9)
        assert sample.inputs[2] == pytest.approx(250 + 300 * k % 600)
