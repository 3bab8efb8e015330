"""Zones in the real daemon whose samples land at the same instant."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from replay.lab.measuring.bench.sizes import Sizes
from replay.lab.measuring.fleet.run import run
from replay.lab.measuring.fleet.scenario import Scenario


def fleet(sizes: Sizes) -> Mapping[str, Any]:
    """The load generator's figures for all zones."""
    with TemporaryDirectory(prefix="thermogate-fleet-") as folder:
        scenario = Scenario(
            sizes.fleet_zones, sizes.fleet_particles, "building-67", sizes.fleet_every, sizes.fleet_rounds
        )
        return run(scenario, Path(folder))
