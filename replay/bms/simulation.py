"""The building in time: the world kept up with the clock, and what its sensors say, faults included."""

import asyncio
import logging
import time
from collections.abc import Callable

import numpy as np

from replay.bms.faults import FaultBoard
from replay.bms.living.building import design
from replay.bms.living.world import STEP, Orders, Snapshot, World
from replay.bms.plant import Channel, Device, devices

TICK = 0.1
"""Real seconds between two looks at the clock."""
_MOST_STEPS = 1000  # per tick, so that the servers get their turn; some 20 ms

_log = logging.getLogger(__name__)


class Simulation:
    """A world of `zones` rooms in a row, its devices and their faults, and what somebody at the plant has set.

    `clock` gives real seconds that never jump.
    """

    def __init__(
        self,
        *,
        zones: int,
        seed: int,
        pace: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.pace = pace
        self.world = World(design(zones, seed), seed)
        self.building = self.world.building
        self.orders = Orders.none(len(self.building.rooms))
        self.plant = devices(self.building, pace=pace)
        self.faults = FaultBoard(self.plant, clock)
        self._clock = clock
        self._began = clock()

    def value(self, device: Device, channel: Channel) -> float:
        """What the sensor of `channel` says now; NaN for "not available"."""
        return self.faults.falsified(device.name, channel.name, channel.read(self._at_sensors()))

    def _at_sensors(self) -> Snapshot:
        """The building where its thermometers are: those that have changed places with the outdoor one are outdoors."""
        now = self.world.now
        swapped = list(self.faults.rooms("swapped-sensors"))
        if not swapped:
            return now
        air = now.air.copy()
        air[swapped] = now.outdoor
        return now._replace(air=air, outdoor=float(now.air[swapped[-1]]))

    def catch_up(self) -> float:
        """Live up to now, or as far as one tick may; how many simulated seconds are missing after that."""
        windows = np.zeros(len(self.building.rooms))
        for room, fault in self.faults.rooms("window").items():
            windows[room] = fault.value
        due = int((self._clock() - self._began) * self.pace / STEP)
        lived = int(self.world.elapsed / STEP)
        for _ in range(min(due - lived, _MOST_STEPS)):
            self.world.step(windows, self.orders)
        return max(due - lived - _MOST_STEPS, 0) * STEP

    async def run(self) -> None:
        """Keep up with the clock until cancelled."""
        warned = False
        while True:
            behind = self.catch_up()
            if behind and not warned:
                warned = True
                _log.warning("the building is %.0f s behind its pace of %g; take a slower one", behind, self.pace)
            await asyncio.sleep(TICK)
