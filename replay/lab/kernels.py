"""Compile what the demo's rooms need, so that `make run` shows forecasts as soon as it shows the page."""

import tempfile
from functools import partial
from pathlib import Path

from service.daemon.process import prepare_process


def main() -> None:
    """Take a room of the demo two hours on from what it has learned, and ask it what comes next."""
    from replay.bms.background import in_background
    from replay.bms.logged import STATE, Demo, live
    from service.config.fitting import fingerprint, make_worker
    from service.config.load import load
    from service.forecast.engine import FanQuestion
    from service.forecast.foresight import NO_WEATHER
    from service.forecast.request import detail
    from service.store.reading import read_state
    from service.zone import snapshot

    with tempfile.TemporaryDirectory() as folder:
        with in_background(partial(live, Demo(Path(folder), pace=60.0))) as (path, _):
            zone = load(path).zones[0]
        with read_state(Path(folder) / STATE) as state:
            checkpoint = state.checkpoint(zone.id, fingerprint(zone))
            *_, last = state.journal.samples_after(zone.id, None)
    assert checkpoint is not None
    worker = make_worker(zone)
    snapshot.restore(worker, checkpoint)
    for time in range(last.time + zone.period, last.time + 2 * 3600, zone.period):
        worker.step(last._replace(time=time))
    FanQuestion(24, {}, (0.95,), 0, detail([25]))(worker, NO_WEATHER, lambda: False)


if __name__ == "__main__":
    prepare_process()
    main()
