"""Thermogate over the rooms of a building: its zones as the daemon runs them, and its REST application."""

import asyncio
import json
import tempfile
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from estimator import registry
from estimator.arrays import Array
from estimator.heat.sun import Location
from estimator.network import presets
from estimator.network.network import Network
from replay.energyplus.buildings import Building
from replay.energyplus.plant import STEP
from service.config.fitting import known_heat
from service.config.known_heat import usually_heated
from service.config.site import Whereabouts
from service.publish.metrics import Metrics
from service.records.outlook import Surroundings
from service.records.sample import Sample
from service.store.store import Store
from service.web.app import create_app
from service.web.server.in_process import ask
from service.zone.plumbing import Plumbing
from service.zone.questions import THREADS, Questions
from service.zone.worker import WorkerSettings, ZoneWorker
from service.zone.zone import Zone

HEATER = "u_heat"
_LEVELS, _MAX_GAP, _HOLD = (0.95,), 12, 900.0
"""What a zone has that does not set them."""
_NEVER = 1e9


def networks_of(building: Building, location: Location | None = None) -> dict[str, Network]:
    """The network `auto` of every room: outdoors, sun, its own heater, and the rooms beside it; where the `location` is
    given, with sun and habits as a zone that sets none has them."""
    found = {}
    for index, room in enumerate(building.rooms):
        beside = [adjacent(building.rooms[other].name) for other in building.neighbours(index)]
        network = presets.automatic(["T_out", HEATER, "I_sol", *beside])
        found[room.name] = (network if location is None else usually_heated(network, location)).validate()
    return found


def adjacent(room: str) -> str:
    """The input of a zone that is the temperature of `room` beside it."""
    return f"{presets.NEIGHBOUR}_{room}"


def inputs_of(
    building: Building, index: int, network: Network, shown: Array, outdoor: float, sun: float, heating: Array
) -> Array:
    """The inputs (n_u,) of the zone of room `index`, from what the thermometers of all rooms show (N,) and the rest."""
    told = {"T_out": outdoor, HEATER: heating[index], "I_sol": sun}
    told |= {adjacent(building.rooms[other].name): shown[other] for other in building.neighbours(index)}
    return np.array([told[channel] for channel in network.inputs])


class Site:
    """The zones of a building, by their rooms' names, in this process; whoever makes it closes it."""

    def __init__(
        self,
        building: Building,
        networks: Mapping[str, Network],
        estimator: str,
        seed: int,
        whereabouts: Whereabouts,
    ) -> None:
        """`networks` by room, an estimator for each, which stands at `whereabouts`."""
        self._open = ExitStack()
        folder = Path(self._open.enter_context(tempfile.TemporaryDirectory(prefix="thermogate-control-")))
        self._runner = self._open.enter_context(asyncio.Runner())
        metrics, store = Metrics({}), Store(folder)
        self._open.callback(store.close)
        pool, asking = (self._open.enter_context(ThreadPoolExecutor(count)) for count in (1, THREADS))
        stopping = threading.Event()
        shared = Plumbing("control", store, pool, Questions(asking, stopping), stopping, metrics, (metrics,), _NEVER)
        self._zones: dict[str, Zone] = {}
        for index, room in enumerate(building.rooms):
            made = registry.build(estimator, networks[room.name], STEP, {})
            settings, heat = WorkerSettings(seed, _LEVELS, _MAX_GAP, _HOLD), known_heat(made.network, STEP, whereabouts)
            worker = ZoneWorker(made, settings, heat)
            beside = [building.rooms[other].name for other in building.neighbours(index)]
            surroundings = Surroundings(
                limits={HEATER: (0.0, room.heater)}, neighbours={adjacent(other): (other, "T_i") for other in beside}
            )
            self._zones[room.name] = Zone(room.name, estimator, "control", worker, shared, surroundings)
        self._app = create_app("control", self._zones, metrics.registry)
        self._running = self._runner.run(self._begun())
        self._open.callback(lambda: self._runner.run(self._ended()))

    def feed(self, samples: Mapping[str, Sequence[Sample]]) -> None:
        """Let every zone take its samples, journaled and in order, to the last."""
        self._runner.run(self._taken(samples))

    def ask(self, method: str, path: str, body: Any) -> Any:
        """What REST answers, as JSON; OSError with its sentence where it refuses."""
        content = b"" if body is None else json.dumps(body).encode()
        place, _, query = path.partition("?")
        host = [(b"host", b"localhost")]
        answer = self._runner.run(ask(self._app, method, place, query=query, body=content, headers=host))
        found = json.loads(answer.body)
        if not answer.good:
            raise OSError(found["detail"])
        return found

    def close(self) -> None:
        self._open.close()

    async def _begun(self) -> list[asyncio.Task[None]]:
        for zone in self._zones.values():
            await zone.prepare()
        return [asyncio.create_task(zone.run()) for zone in self._zones.values()]

    async def _taken(self, samples: Mapping[str, Sequence[Sample]]) -> None:
        for name, one in samples.items():
            await self._zones[name].intake.accept(one)
        for zone in self._zones.values():
            await zone.settled()

    async def _ended(self) -> None:
        for zone in self._zones.values():
            await zone.intake.close()
        await asyncio.gather(*self._running)
