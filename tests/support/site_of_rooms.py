"""Real zones behind the real routes, fed in a moment: rooms that have learned, some of them next door to each other."""

import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from fastapi import FastAPI
from support.thermostat_house import samples as told
from support.zone_samples import fed

from estimator import registry
from estimator.network.presets import network
from service.publish.metrics import Metrics
from service.records.outlook import Surroundings
from service.records.sample import Sample
from service.store.store import Store
from service.web.app import create_app
from service.zone.plumbing import Plumbing
from service.zone.questions import Questions
from service.zone.worker import WorkerSettings, ZoneWorker
from service.zone.zone import Zone

PERIOD = 300
SMALL = {"rbpf": {"particles": 300}, "mkf": {"particles": 40, "scenarios": 200}}


class Room(NamedTuple):
    """How a zone is made: estimator, preset, samples that it learned from, and what it knows of its inputs."""

    estimator: str = "rbpf"
    preset: str = "titeth"
    samples: int = 40
    surroundings: Surroundings = Surroundings()
    temperature: float = 20.0
    told: bool = False
    """Whether it is a house with a thermostat that is told set-points."""
    heated: bool = False
    """Whether its temperature is that of a simulated room, in winter and with a thermostat at `temperature`."""


def winter(samples: int, wanted: float) -> Iterator[Sample]:
    """A heavy room that loses about 67 W/K, at 0 degC outside, heated with 3 kW below `wanted`."""
    rng = np.random.default_rng(7)
    air, walls, heat = wanted, wanted - 6.0, 0.0
    for k in range(samples):
        outside = 3.0 * np.sin(2 * np.pi * k * PERIOD / 86400)
        heat = 3000.0 * (air < wanted + 0.3 * (heat > 0.0))
        yield Sample.measured(k * PERIOD, np.array([air + 0.02 * rng.standard_normal()]), np.array([outside, heat]))
        for _ in range(10):
            seconds = PERIOD / 10
            through = 200.0 * (air - walls)
            air += seconds * (heat - through) / 2e6
            walls += seconds * (through - 100.0 * (walls - outside)) / 2e7


def sample(k: int, inputs: list[float], temperature: float = 20.0) -> Sample:
    """Sample k of a room that is heated now and then."""
    rng = np.random.default_rng(k)
    outputs = np.array([temperature + np.sin(k / 8) + 0.05 * rng.standard_normal()])
    return Sample.measured(k * PERIOD, outputs, np.array(inputs))


def worker_of(room: Room) -> ZoneWorker:
    """A worker that has learned."""
    net = network(room.preset)
    estimator = registry.build(room.estimator, net, PERIOD, SMALL.get(room.estimator, {}))
    worker = ZoneWorker(estimator, WorkerSettings(3, (0.95,), 12, 900.0))
    if room.heated:
        return fed(worker, winter(room.samples, room.temperature))
    if room.told:
        return fed(worker, told(room.samples * PERIOD // 86400, PERIOD))
    boundaries = [5.0, room.temperature][: len(net.boundaries)]
    inputs = ([*boundaries, *[1500.0 * (k % 12 < 6)] * len(net.heat_channels)] for k in range(room.samples))
    return fed(worker, (sample(k, row, room.temperature) for k, row in enumerate(inputs)))


@contextmanager
def site_of(folder: Path, rooms: Mapping[str, Room]) -> Iterator[tuple[FastAPI, dict[str, Zone]]]:
    """The application over zones by id, and the zones."""
    metrics, store = Metrics({}), Store(folder)
    with ThreadPoolExecutor(2) as pool:
        stopping = threading.Event()
        shared = Plumbing("htwg", store, pool, Questions(pool, stopping), stopping, metrics, (metrics,), 1e9)
        zones = {
            name: Zone(name, room.estimator, "mark", worker_of(room), shared, room.surroundings)
            for name, room in rooms.items()
        }
        yield create_app("htwg", zones, metrics.registry), zones
    store.close()
