"""Rooms that share walls, simulated together: what each knows of its neighbours is what they forecast."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from adapters.reading import Quality
from estimator.arrays import Array
from estimator.statespace.simulate import Room, coupled_paths
from service.records.outlook import InputOrigin, Outlook
from service.records.update import Update
from service.records.view import ZoneView

_LATEST = 12
"""Periods that a room's forecast may lie behind that of its neighbours."""


@dataclass
class Part:
    """A zone in a request: its newest update, and its inputs under the plan at hand."""

    view: ZoneView
    update: Update
    outlook: Outlook
    room: Room | None = None
    """Its physics; None where there are none, or nobody is coupled with it."""

    @property
    def start(self) -> int:
        """The valid time of its forecast, UTC s."""
        return self.update.forecast.valid_time

    @property
    def foreseen(self) -> Mapping[str, tuple[str, str]]:
        """Its neighbours, by the inputs that no plan says."""
        planned = {origin.channel for origin in self.outlook.origins if origin.origin == "plan"}
        return {name: other for name, other in self.view.surroundings.neighbours.items() if name not in planned}


class ToldRoom:
    """A room without physics: its forecast as it is, whatever its neighbours do."""

    def __init__(self, path: Array) -> None:
        """`path` (h + 1, n_y): means of its outputs."""
        self._path, self._step = path, 0

    def outputs(self) -> Array:
        """(n_y,) [degC] now."""
        row: Array = self._path[min(self._step, len(self._path) - 1)]
        return row

    def step(self, inputs: Array) -> None:
        """One step on."""
        self._step += 1

    def anew(self) -> ToldRoom:
        """The same at its beginning."""
        return ToldRoom(self._path)


def coupled(parts: Sequence[Part]) -> None:
    """Write into the inputs of `parts` what their neighbours among them forecast; the inputs that are planned stay.

    Rooms of one period are simulated in step; one whose forecast begins earlier than another's is simulated up to
    there first. Neighbours of another period, or far behind, stay as they are foreseen.
    """
    for period in {part.view.period for part in parts if part.room is not None}:
        group = [part for part in parts if part.room is not None and part.view.period == period]
        latest = max(part.start for part in group)
        group = [part for part in group if (latest - part.start) / period <= _LATEST]
        _in_step(group, latest, period)


def _in_step(group: Sequence[Part], latest: int, period: float) -> None:
    place = {part.view.id: index for index, part in enumerate(group)}
    rooms, rest, behind = [], [], []
    for part in group:
        assert part.room is not None
        room, late = part.room.anew(), round((latest - part.start) / period)
        for inputs in part.outlook.rows[:late]:
            room.step(inputs)
        rooms.append(room)
        behind.append(late)
        rest.append(part.outlook.rows[late:])
    steps = max((len(rows) for rows in rest), default=0)
    # A room that is late ends earlier: its last inputs go on for as long as the others are simulated.
    padded = [np.concatenate([rows, np.repeat(rows[-1:], steps - len(rows), axis=0)]) for rows in rest if len(rows)]
    if len(padded) < len(group):
        return
    links = []
    for part in group:
        network = part.view.network
        links.append(
            {
                network.inputs.index(channel): (place[zone], group[place[zone]].view.network.measured.index(output))
                for channel, (zone, output) in part.foreseen.items()
                if zone in place
            }
        )
    told = coupled_paths(rooms, padded, links)
    for part, rows, late, before, own in zip(group, told, behind, rest, links, strict=True):
        filled = part.outlook.rows.copy()
        filled[late:] = rows[: len(before)]
        origins = list(part.outlook.origins)
        for column in own:
            zone, _ = part.foreseen[part.view.network.inputs[column]]
            age = float(part.update.forecast.issue_time - group[place[zone]].update.forecast.issue_time)
            channel = part.view.network.inputs[column]
            origins[column] = InputOrigin(channel, "neighbour", zone, max(0.0, age), Quality.GOOD)
        part.outlook = Outlook(filled, tuple(origins))
