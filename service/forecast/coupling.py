"""Rooms that share walls, simulated together: what each knows of its neighbours is what they forecast."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from adapters.reading import Quality
from estimator.statespace.simulate import coupled_paths
from service.forecast.engine import Neighbour, Part
from service.records.outlook import InputOrigin
from service.records.view import ZoneView

_LATEST = 12
"""Periods that a room's forecast may lie behind that of its neighbours."""


class Member(NamedTuple):
    """A zone that is simulated with others: `next_door` names zone and output by the inputs that are not planned."""

    view: ZoneView
    part: Part
    next_door: Mapping[str, tuple[str, str]]

    @property
    def start(self) -> int:
        """The valid time of its forecast, UTC s."""
        return self.part.update.forecast.valid_time


def coupled(members: Sequence[Member]) -> dict[str, dict[str, Neighbour]]:
    """What the neighbours of each of `members` are forecast to do, by zone and input. Rooms of one period are simulated
    in step, one whose forecast begins earlier up to there first; others, or those far behind, are left out."""
    found: dict[str, dict[str, Neighbour]] = {}
    for period in {member.view.period for member in members}:
        group = [member for member in members if member.view.period == period]
        latest = max(member.start for member in group)
        found |= _in_step([one for one in group if (latest - one.start) / period <= _LATEST], latest, period)
    return found


def _in_step(group: Sequence[Member], latest: int, period: float) -> dict[str, dict[str, Neighbour]]:
    place = {member.view.id: index for index, member in enumerate(group)}
    rooms, rest = [], []
    for member in group:
        room, rows = member.part.room.anew(), member.part.outlook.rows
        late = round((latest - member.start) / period)
        for inputs in rows[:late]:
            room.step(inputs)
        rooms.append(room)
        rest.append(rows[late:])
    if not all(len(rows) for rows in rest):
        return {}
    steps = max(len(rows) for rows in rest)
    # A room that is late ends earlier: its last inputs go on for as long as the others are simulated.
    padded = [np.concatenate([rows, np.repeat(rows[-1:], steps - len(rows), axis=0)]) for rows in rest]
    links = [
        {
            member.view.network.inputs.index(channel): (zone, place[zone], output)
            for channel, (zone, output) in member.next_door.items()
            if zone in place
        }
        for member in group
    ]
    measured = [member.view.network.measured for member in group]
    ends = [
        {column: (other, measured[other].index(output)) for column, (_, other, output) in own.items()} for own in links
    ]
    found: dict[str, dict[str, Neighbour]] = {}
    for member, rows, own in zip(group, coupled_paths(rooms, padded, ends), links, strict=True):
        issued = member.part.update.forecast.issue_time
        for column, (zone, other, _) in own.items():
            channel = member.view.network.inputs[column]
            age = max(0.0, float(issued - group[other].part.update.forecast.issue_time))
            origin = InputOrigin(channel, "neighbour", zone, age, Quality.GOOD)
            found.setdefault(member.view.id, {})[channel] = Neighbour(latest, rows[:, column], origin)
    return found
