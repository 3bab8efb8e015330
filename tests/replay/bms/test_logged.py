"""The demo's building: its rooms have learned what it has lived when the daemon comes."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np

from replay.bms.background import in_background
from replay.bms.living.building import design
from replay.bms.living.world import World
from replay.bms.logged import FILE, LIVED_DAYS, ROOMS, STATE, Demo, live
from service.config.fitting import fingerprint, make_worker
from service.config.load import load
from service.store.checkpoint import CheckpointStore
from service.zone import snapshot


def test_a_world_goes_on_with_the_same_numbers_where_another_one_stood() -> None:
    first, windows = World(design(2, 3), 3), np.zeros(2)
    for _ in range(50):
        first.step(windows)
    second = World(design(2, 3), 3)
    second.go_on(json.loads(json.dumps(first.written())))
    for _ in range(50):
        first.step(windows)
        second.step(windows)
    assert all(np.array_equal(one, other) for one, other in zip(first.now, second.now, strict=True))
    assert first.elapsed == second.elapsed


def test_the_demo_begins_with_rooms_that_have_learned(tmp_path: Path) -> None:
    with in_background(partial(live, Demo(tmp_path, pace=60.0))) as (path, _):
        config = load(path)
        header, first = (tmp_path / FILE).read_text().splitlines()[:2]
    assert (tmp_path / STATE).stat().st_mode & 0o077 == 0
    assert len(config.zones) == ROOMS
    for zone in config.zones:
        checkpoint = CheckpointStore(tmp_path / STATE / "checkpoints").load(zone.id, fingerprint(zone))
        assert checkpoint is not None, "another network than that of the demo: make demo-state"
        worker = make_worker(zone)
        snapshot.restore(worker, checkpoint)
        assert worker.progress.samples == LIVED_DAYS * 96 + 1
        for horizon in worker.trust.horizons:
            assert horizon.level == "trusted" or (horizon.level != "learning" and horizon.reason)
    assert header.startswith("time,weather_T_out,")
    assert first.startswith("2025-01-27T05:00:00")
