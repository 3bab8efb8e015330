"""Memory of zones: resident memory of one process that holds more and more of them, each with a real worker."""

from __future__ import annotations

import asyncio
import gc
import os
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tomli_w

from replay.lab.measuring.bench.sections.months import configuration
from replay.lab.measuring.bench.sizes import Sizes
from replay.lab.measuring.processes import resident_bytes
from replay.simulated import semi_synthetic
from service.config.fitting import make_alignment, make_worker
from service.config.load import load
from service.config.recording import recorded
from service.config.site import Config
from service.records.sample import Sample

_STEPS = 3


def memory(sizes: Sizes) -> Mapping[str, Any]:
    """Resident memory against the number of zones, and the line through it: a fixed base and so much a zone."""
    with TemporaryDirectory(prefix="thermogate-bench-") as name:
        folder = Path(name)
        recording = semi_synthetic.write_csv(semi_synthetic.generate(None, days=1, seed=1), folder / "day.csv")
        path = folder / "zone.toml"
        path.write_text(tomli_w.dumps(configuration(recording, sizes.particles)), encoding="utf-8")
        config = load(path)
        samples = asyncio.run(_samples(config))
    (table,) = config.zones
    zones: list[Any] = []
    resident = []
    for count in sizes.resident_zones:
        while len(zones) < count:
            own = table.model_copy(update={"id": f"zone-{len(zones)}", "seed": len(zones)})
            worker = make_worker(own)
            for sample in samples[:_STEPS]:
                worker.step(sample)
            zones.append((worker, make_alignment(own)))
        gc.collect()
        resident.append(resident_bytes(os.getpid()))
    per_zone, base = np.polyfit(sizes.resident_zones, resident, 1)
    return {
        "particles": sizes.particles,
        "zones": list(sizes.resident_zones),
        "resident_bytes": resident,
        "bytes_per_zone": float(per_zone),
        "base_bytes": float(base),
    }


async def _samples(config: Config) -> list[Sample]:
    (table,) = config.zones
    alignment, samples = make_alignment(table), []
    async for part in recorded(config, [table.id], None, None):
        if part.now is not None:
            samples += alignment.add(part.source, part.readings, part.now)
    return samples
