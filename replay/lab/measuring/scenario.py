"""A building of many zones whose samples all land at the same instant, again and again, as files.

One recording feeds every zone: a row of all columns for each period. Paced, a row closes the interval before it for all
zones at once, at instants that follow each other without drift.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from adapters.fields.durations import format_duration
from estimator.network.presets import network
from replay.recorded.tables import cells, utc_stamps, write_table
from replay.simulated import semi_synthetic
from replay.simulated.semi_synthetic import PERIOD

SITE = "fleet"
_SPARE_ROUNDS = 3
"""Rows beyond the last round, so that no zone comes to its end while it is measured."""


class Scenario(NamedTuple):
    """What to write: `zones` of `preset` with `particles` each, an instant every `every` s, `rounds` of them measured.

    The round before the measured ones starts the filters. `every` None: as fast as it goes.
    """

    zones: int
    particles: int
    preset: str
    every: float | None
    rounds: int

    @property
    def rows(self) -> int:
        """Rows of the recording."""
        return 1 + self.rounds + _SPARE_ROUNDS


def zone_ids(count: int) -> list[str]:
    """The ids of the zones."""
    return [f"zone-{index:04d}" for index in range(count)]


def write(scenario: Scenario, folder: Path, zenoh_port: int | None = None) -> Path:
    """Write recording and configuration into `folder`, which is made; the configuration's path.

    The daemon connects to a listener on `zenoh_port`, if there is one, and waits for it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    house, rows = network(scenario.preset), scenario.rows
    recording = semi_synthetic.generate(None, seed=1)
    columns, zones = {"timestamp": utc_stamps(recording.times[:rows])}, []
    for index, zone in enumerate(zone_ids(scenario.zones)):
        # Every zone lives in another stretch of the same months.
        begin = index * 20 % (len(recording.times) - rows + 1)
        channels = {}
        for channel in house.channels:
            column = f"{zone} {channel}"
            columns[column] = cells(recording.columns[channel][begin : begin + rows], 4)
            channels[channel] = {"source": "recording", "column": column, "unit": house.channel_unit(channel)}
        zones.append(
            {
                "id": zone,
                "period": format_duration(PERIOD),
                "network": scenario.preset,
                "estimator": "rbpf",
                "estimator_options": {"particles": scenario.particles},
                "channels": channels,
            }
        )
    source = {
        "kind": "csv",
        "files": [write_table(folder / "fleet.csv", columns).name],
        "timestamp": {"column": "timestamp"},
        "pace": "max" if scenario.every is None else PERIOD / scenario.every,
    }
    # The clock of the recording starts when the listener hears every zone.
    listener = {"listen": [], "connect": [f"tcp/127.0.0.1:{zenoh_port}"], "await_subscriber": "2min"}
    tables: dict[str, Any] = {
        "site": {"id": SITE, "state_dir": "state"},
        "http": {"port": 0},
        "zenoh": {"enabled": False} if zenoh_port is None else listener,
        "sources": {"recording": source},
        "zones": zones,
    }
    path = folder / "fleet.toml"
    path.write_text(tomli_w.dumps(tables), encoding="utf-8")
    return path
