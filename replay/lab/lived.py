"""`make demo-state`: what the demo's daemon knows at its start, learned anew from the days that its building has lived.
What comes again within a day, forecasts that wait for their time and what was known before, is left out."""

import json
import sqlite3
import tarfile
import tempfile
import time
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np

from replay.bms.background import in_background
from replay.bms.living.building import design
from replay.bms.living.world import World
from replay.bms.logged import BUILDING, FILE, LEARNED, LIVED_DAYS, LIVED_ROWS, ROOMS, SEED, STATE, Demo, live
from replay.localtime import DAY
from replay.recorded.learning import learn
from service.config.fitting import fingerprint
from service.config.load import load
from service.recordings.history import survey
from service.store.checkpoint import Checkpoint, CheckpointStore
from service.store.store import CHECKPOINTS, JOURNAL

_PACE = 60.0
_LEFT_OUT = ("earlier", "live.issues.", "live.drawn.")
_PENDING = {"step": 1, "inputs": 1, "issued": 0}
"""What is kept of the forecasts that wait, and how many of the newest: none, beside the newest inputs."""


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder)
        state = directory / STATE
        with in_background(partial(live, Demo(directory, pace=_PACE, knows=False))) as (path, _):
            while len((directory / FILE).read_bytes().splitlines()) <= LIVED_ROWS:
                time.sleep(1.0)
        config = load(path, ["sources.logger.follow=false"])
        learn(config, survey(config, config.zones))
        checkpoints = CheckpointStore(state / CHECKPOINTS)
        for zone in config.zones:
            found = checkpoints.load(zone.id, fingerprint(zone))
            assert found is not None
            for file in checkpoints.files(zone.id):
                file.unlink()
            checkpoints.save(zone.id, _light(found))
        with closing(sqlite3.connect(state / JOURNAL)) as connection:
            connection.execute("VACUUM")
        (directory / BUILDING).write_text(json.dumps(_lived().written()), encoding="utf-8")
        with tarfile.open(LEARNED, "w:xz", preset=9) as archive:
            for part in (BUILDING, STATE, f"{STATE}/{JOURNAL}", f"{STATE}/{CHECKPOINTS}"):
                archive.add(directory / part, part, recursive=part.endswith(CHECKPOINTS))


def _lived() -> World:
    world = World(design(ROOMS, SEED), SEED)
    while world.elapsed < LIVED_DAYS * DAY:
        world.step(np.zeros(ROOMS))
    return world


def _light(checkpoint: Checkpoint) -> Checkpoint:
    """`checkpoint` without forecasts that wait, and without what was known earlier."""
    arrays = {}
    for name, value in checkpoint.arrays.items():
        _, pending, rest = name.partition("pending.")
        if name.startswith(_LEFT_OUT) or (pending and rest not in _PENDING):
            continue
        arrays[name] = value[len(value) - _PENDING[rest] :] if pending and value.ndim else value
    return checkpoint._replace(arrays=arrays)


if __name__ == "__main__":
    main()
