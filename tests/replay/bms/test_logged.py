"""The demo's building: its rooms have learned what it has lived when the daemon comes."""

import json
import socket
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path

import numpy as np
from support.waiting import wait_until

from replay.bms.background import in_background
from replay.bms.living.building import design
from replay.bms.living.world import Orders, World
from replay.bms.logged import BUILDING, FILE, LIVED_DAYS, ROOMS, SEED, STATE, Demo, live
from replay.commands.demo import ports
from service.config.fitting import fingerprint, make_worker
from service.config.load import load
from service.config.site import ZoneConfig
from service.records.sample import Sample
from service.store.checkpoint import CheckpointStore
from service.zone import snapshot
from service.zone.worker import ZoneWorker


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


def learned(folder: Path, zone: ZoneConfig) -> ZoneWorker:
    """The worker of a zone of the demo in `folder`, as the demo's daemon begins with it."""
    checkpoint = CheckpointStore(folder / STATE / "checkpoints").load(zone.id, fingerprint(zone))
    assert checkpoint is not None, "another network than that of the demo: make demo-state"
    worker = make_worker(zone)
    snapshot.restore(worker, checkpoint)
    return worker


def test_the_demo_begins_with_rooms_that_have_learned(tmp_path: Path) -> None:
    with in_background(partial(live, Demo(tmp_path, pace=60.0))) as (path, _):
        config = load(path)
        # The first row comes a moment after the header.
        wait_until(lambda: (tmp_path / FILE).read_text().count("\n") > 1)
        header, first = (tmp_path / FILE).read_text().splitlines()[:2]
    assert (tmp_path / STATE).stat().st_mode & 0o077 == 0
    assert len(config.zones) == ROOMS
    for zone in config.zones:
        worker = learned(tmp_path, zone)
        assert worker.progress.samples == LIVED_DAYS * 96 + 1
        for horizon in worker.trust.horizons:
            assert horizon.level == "trusted" or (horizon.level != "learning" and horizon.reason)
    assert header.startswith("time,weather_T_out,")
    assert first.startswith("2025-01-27T05:00:00")


def test_a_demo_whose_usual_ports_are_taken_starts_beside_them_and_says_so() -> None:
    with ExitStack() as held:
        for port in (8080, 7447):
            other = held.enter_context(socket.socket())
            # Who holds it already, as a demo beside this test, takes it just as well.
            with suppress(OSError):
                other.bind(("127.0.0.1", port))
                other.listen()
        changes, said = ports(8080)
    assert changes == ["http.port=0", "zenoh.enabled=false"]
    assert said == [
        "Port 8080 is taken; REST and the page are on a free one.",
        "Port 7447 is taken, so Zenoh is off in this demo.",
    ]


def test_a_thermostat_that_is_turned_up_makes_no_telemetry_doubtful(tmp_path: Path) -> None:
    with in_background(partial(live, Demo(tmp_path, pace=60.0))) as (path, _):
        config = load(path)
    world = World(design(ROOMS, SEED), SEED)
    world.go_on(json.loads((tmp_path / BUILDING).read_text()))
    turned, beside = (learned(tmp_path, zone) for zone in config.zones[1:3])
    orders = Orders.none(ROOMS)
    orders.set_point[1] = 23.0
    # The interval of the last sample.
    for _ in range(180):
        world.step(np.zeros(ROOMS))
    for _ in range(120):
        begin, power = world.now, np.zeros(ROOMS)
        for _ in range(180):
            power += world.now.power / 180
            world.step(np.zeros(ROOMS), orders)
        for index, worker in ((1, turned), (2, beside)):
            told = {"T_out": begin.outdoor, "I_sol": begin.irradiance, "u_heat": power[index]}
            told |= {f"T_adj_room{other + 1}": begin.air[other] for other in (index - 1, index + 1)}
            inputs = np.array([told[channel] for channel in worker.network.inputs])
            sample = Sample.measured(round(begin.time), begin.air[[index]], inputs)
            worker.step(sample._replace(setpoint=begin.set_point[index]))
            assert worker.carried.suspicions == ()
    assert turned.carried.recent.values[:, 0].max() > 22.9
