"""What of the telemetry cannot be believed: each channel against its own fortnight, and the room against all of them.

The reference is what was measured until two days ago, or until the oldest suspicion began. A suspicion stands until the
channel behaves as in the reference again, or until too little reference is left: then what was suspected is the new
normal. All limits are multiples of what the reference has shown: a coarse or a noisy sensor is judged by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.arrays import Array
from estimator.diagnosis.finding import (
    CHANNELS_SWAPPED,
    METER_DEAD,
    METER_LATE,
    SENSOR_DRIFTS,
    SENSOR_JUMPED,
    SENSOR_SPIKES,
    SENSOR_STUCK,
    SIGN_FLIPPED,
    TELEMETRY,
    UNIT_CHANGED,
    Finding,
)
from estimator.diagnosis.telemetry.recent import Recent, slot, until
from estimator.diagnosis.telemetry.response import Response, lateness, response, unexplained
from estimator.network.network import Network

EVERY = 3600
"""s between two looks at the telemetry."""

_HOUR = 3600
_RECENT = 48 * _HOUR
"""s that do not belong to the reference: what is found later than that was taken for true meanwhile."""

_LEAST = 6.0
"""Days of reference before anything is suspected: less has seen too little of what the room does."""

_LEAST_JUMP = 1.0
"""K."""

_WARMING, _MUCH, _SOME = 6, 1.5, 0.6
"""h over which warming that nothing explains is looked at, and multiples of the largest that the reference has seen."""

_LATELY = 12.0
"""h in which spikes count."""

SETTLED = 7 * 24.0
"""h after which another level is the usual one, and what was suspected is the new truth: what was learned of it is
kept."""

Kind = str
"""What a channel measures: "room", "outside" (any other temperature), "heat" (W) or "other"."""


class Suspicion(NamedTuple):
    """That a channel tells something else than it should."""

    name: str
    column: int
    """0 is the first output, then the inputs."""
    since: float
    """UTC s."""


class Look(NamedTuple):
    """The telemetry of a zone at one time, n channels in slots of `step` h."""

    kinds: tuple[Kind, ...]
    step: float
    past: Array
    """(m, n): the reference, the oldest first."""
    new: Array
    """(k, n): all since then."""
    response: Response | None
    """How the room answered its inputs in the reference; None where it is too short."""

    def slots(self, hours: float) -> int:
        """Slots in so many hours, at least one."""
        return max(1, round(hours / self.step))

    def last(self, column: int, hours: float) -> Array:
        """What a channel told in the last hours."""
        return np.asarray(self.new[-self.slots(hours) :, column])

    def columns(self, *kinds: Kind) -> Iterator[int]:
        """The channels of these kinds."""
        return (column for column, kind in enumerate(self.kinds) if kind in kinds)


def kinds(network: Network) -> tuple[Kind, ...]:
    """What the first output and the inputs of `network` measure."""
    of_units = {"degC": "outside", "W": "heat"}
    return ("room", *(of_units.get(network.channel_unit(channel), "other") for channel in network.inputs))


def looked(network: Network, recent: Recent, before: tuple[Suspicion, ...], time: float) -> tuple[Suspicion, ...]:
    """What is suspected at `time` [UTC s], when these stood `before`."""
    rows, step = until(recent, time), slot(recent) / _HOUR
    onset = min([time - _RECENT, *(one.since for one in before)])
    split = len(rows) - min(len(rows), round((time - onset) / slot(recent)))
    if np.isfinite(rows[:split, 0]).sum() * step < _LEAST * 24.0:
        return ()
    of, hour = kinds(network), max(1, round(1.0 / step))
    look = Look(of, step, rows[:split], rows[split:], response(rows[:split], rows[split:], of, hour))
    found = {(name, column): hours for test in _TESTS for name, column, hours in test(look)}
    # Channels that have changed places are no other riddle.
    if any(name == CHANNELS_SWAPPED for name, _ in found):
        found = {key: hours for key, hours in found.items() if key[0] == CHANNELS_SWAPPED}
    since = {(one.name, one.column): one.since for one in before}
    return tuple(
        Suspicion(name, column, since.get((name, column), time - hours * _HOUR))
        for (name, column), hours in found.items()
    )


_SENTENCES = {
    CHANNELS_SWAPPED: "{channel} and the room's thermometer tell each other's temperatures; exchange the two channels",
    SENSOR_STUCK: "{channel} has told the same to the last digit for longer than ever; check sensor, battery and bus",
    SENSOR_SPIKES: "{channel} leaps away and back within the hour; check its wiring and whether two devices share its "
    "address",
    SENSOR_JUMPED: "{channel} jumped to another level as never before and stays there; check whether the sensor was "
    "moved, exchanged or calibrated, and whether something heats past the meter",
    SENSOR_DRIFTS: "{channel} is further from its usual level than ever, which the heating does not explain; compare "
    "it with a second thermometer",
    UNIT_CHANGED: "{channel} tells far more or far less than it ever told; check its unit (W or kW) and its scale",
    SIGN_FLIPPED: "{channel} tells the negative of what it should; check its sign, scale and wiring",
    METER_DEAD: "{channel} tells of no heat, and the room warms as it never did without; check the meter",
    METER_LATE: "the room follows {channel} an hour before it is told; check the clock and the averaging of the meter",
}
"""Problem and remedy, by the name of the finding."""


def among(findings: tuple[Finding, ...], network: Network, suspicions: tuple[Suspicion, ...]) -> tuple[Finding, ...]:
    """`findings` with those of the `suspicions` in place of earlier ones about the telemetry."""
    channels = (network.measured[0], *network.inputs)
    told = (
        Finding(one.name, channels[one.column], _SENTENCES[one.name].format(channel=channels[one.column]))
        for one in sorted(suspicions, key=lambda one: TELEMETRY.index(one.name))
    )
    return (*told, *(one for one in findings if one.finding not in TELEMETRY))


Found = Iterator[tuple[str, int, float]]
"""Name, channel, and for how many hours."""


def _stuck(look: Look) -> Found:
    """A thermometer whose value has stayed the same for longer than ever."""
    for column in look.columns("room", "outside"):
        hours = _same(np.concatenate([look.past[:, column], look.new[:, column]])) * look.step
        longest = hours[: len(look.past)].max()
        if hours[-1] > max(2.0, 3.0 * longest):
            yield SENSOR_STUCK, column, float(hours[-1])


def _same(values: Array) -> Array:
    """How many slots before each one the value was last another; 0 where there is none."""
    known = np.flatnonzero(~np.isnan(values))
    same = np.zeros(len(values))
    if len(known):
        changed = np.concatenate([[True], values[known][1:] != values[known][:-1]])
        begun = np.maximum.accumulate(np.where(changed, np.arange(len(known)), 0))
        same[known] = known - known[begun]
    return same


class _Jump(NamedTuple):
    """A step of a thermometer that nothing took back."""

    place: int
    """Slot of `Look.new` before it."""
    before: float
    after: float


def _jumps(look: Look, column: int) -> tuple[list[_Jump], int]:
    """The jumps of a thermometer that are larger than any before and still stand, and how many went to and fro within
    an hour."""
    steps, limits = np.diff(look.new[:, column]), _largest(look, column)
    standing: list[int] = []
    spikes = 0
    for place in np.flatnonzero(np.abs(steps) > limits).tolist():
        if standing and steps[place] * steps[standing[-1]] < 0.0:
            lately = (len(steps) - place) * look.step <= _LATELY
            spikes += (place - standing.pop()) * look.step <= 1.0 and lately
        else:
            standing.append(place)
    found = []
    for place in standing:
        before = _middle(look.new[max(place - look.slots(0.5), 0) : place + 1, column])
        after = _middle(look.new[place + 1 : place + 1 + look.slots(0.5), column])
        if abs(after - before) > 0.6 * abs(steps[place]):
            found.append(_Jump(place, before, after))
    return found, spikes


def _largest(look: Look, column: int) -> Array:
    """(k - 1,): what a step of a thermometer between two new slots must exceed: twice the largest of the reference,
    in a room the largest of times that were heated, or were not, alike."""
    values = np.concatenate([look.past[:, column], look.new[:, column]])
    heated = np.zeros(len(values) - 1, dtype=np.int64)
    for meter in look.columns("heat") if column == 0 else ():
        quiet = _quiet(look, meter)
        heated |= (quiet[1:] == 0.0) | (quiet[:-1] < 1.0)
    sizes = np.abs(np.diff(values))
    split = len(look.past)
    largest = [np.nanmax(sizes[: split - 1][heated[: split - 1] == which], initial=0.0) for which in (0, 1)]
    return np.maximum(_LEAST_JUMP, 2.0 * np.array(largest)[heated[split:]])


def _middle(values: Array) -> float:
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else np.nan


def _leaps(look: Look) -> Found:
    """Thermometers that jump: to and fro, to another level, to their own negative, or to each other's place."""
    standing = {}
    for column in look.columns("room", "outside"):
        standing[column], spikes = _jumps(look, column)
        if spikes >= 2:
            yield SENSOR_SPIKES, column, _LATELY
    for column, jumps in standing.items():
        for jump in jumps:
            hours = (len(look.new) - 1 - jump.place) * look.step
            # A window or a door: only what stays tells of a sensor.
            if not 1.0 <= hours <= SETTLED:
                continue
            if column and _exchanged(jump, standing[0]):
                yield CHANNELS_SWAPPED, column, hours
            elif column and abs(jump.after + jump.before) < 0.35 * abs(jump.after - jump.before):
                # After a day the shape of that day says whether it is still so.
                if hours <= 24.0:
                    yield SIGN_FLIPPED, column, hours
            else:
                yield SENSOR_JUMPED, column, hours


def _exchanged(outside: _Jump, room: list[_Jump]) -> bool:
    """Whether the room's thermometer jumped to where the other one was, at the same time, and the other way round."""
    return any(
        abs(one.place - outside.place) <= 1
        and abs(one.after - outside.before) < 2.0
        and abs(outside.after - one.before) < 2.0
        for one in room
    )


def _turned(look: Look) -> Found:
    """A thermometer outside whose days are upside down."""
    day = look.slots(24.0)
    for column in look.columns("outside"):
        past, last = look.past[:, column], look.new[-day:, column]
        whole = past[len(past) % day :].reshape(-1, day)
        if len(whole) < 4 or np.isnan(last).mean() > 0.2:
            continue
        # The reference ends when the new rows begin: their first slot is the one after a whole day.
        shape = (
            np.roll(np.nanmean(whole, axis=0), -(len(look.new) % day)) if len(look.new) % day else np.nanmean(whole, 0)
        )
        past_slopes = [_slope(np.nanmean(whole, axis=0), one) for one in whole]
        slope = _slope(shape, last)
        if slope < -0.35 and slope < 1.5 * min([0.0, *past_slopes]):
            yield SIGN_FLIPPED, column, 24.0


def _slope(shape: Array, values: Array) -> float:
    """How strongly `values` (k,) follow the `shape` (k,) of a day beside a straight line."""
    design = np.column_stack([np.ones(len(shape)), np.linspace(-1.0, 1.0, len(shape)), shape - np.nanmean(shape)])
    known = ~np.isnan(values) & ~np.isnan(shape)
    return float(np.linalg.lstsq(design[known], values[known], rcond=None)[0][2]) if known.sum() > 3 else 0.0


def _amounts(look: Look) -> Found:
    """Meters that tell a thousand times what they told, a thousandth of it, or less than nothing."""
    for column in look.columns("heat"):
        past, new = look.past[:, column], look.new[:, column]
        highest, lowest = np.nanmax(past, initial=0.0), np.nanmin(past, initial=0.0)
        told = np.flatnonzero(np.abs(new) > 1e-6 * highest)
        if not highest > 0.0 or not len(told):
            continue
        latest = new[told[-look.slots(3.0) :]]
        size = float(np.median(np.abs(latest)))
        usual = np.abs(past[np.abs(past) > 1e-6 * highest])
        small = (usual < highest / 300.0).mean()
        large, little = np.abs(new) > 20.0 * highest, (np.abs(new) > 0.0) & (np.abs(new) < highest / 300.0)
        if size > 20.0 * highest and _as_usual(np.abs(new[large]).max() / 1000.0, usual):
            yield UNIT_CHANGED, column, _since(look, large)
        elif (
            len(latest) == look.slots(3.0)
            and np.abs(latest).max() < highest / 300.0
            and small < 0.1
            and _as_usual(np.abs(new[little]).max() * 1000.0, usual)
        ):
            yield UNIT_CHANGED, column, _since(look, little)
        if lowest >= -0.01 * highest and latest.min() < -0.05 * highest and latest.max() <= 0.0:
            yield SIGN_FLIPPED, column, _since(look, new < -0.01 * highest)


def _as_usual(size: float, usual: Array) -> bool:
    """Whether the most that a meter tells, `size` [W], is like what it has told as a rule, `usual` (n,). The noise of a
    heater that is off is not, in any unit, nor is the first heat after a summer of such noise."""
    return bool(np.quantile(usual, 0.1) <= size <= 1.5 * usual.max())


def _since(look: Look, where: npt.NDArray[np.bool_]) -> float:
    """Hours since the first of the new slots that are so."""
    return float(len(where) - np.argmax(where)) * look.step


def _silent(look: Look) -> Found:
    """A meter that tells of no heat, in a room that has warmed meanwhile by far more than it ever did unexplained."""
    found = look.response
    if found is None:
        return
    warmer = unexplained(found, _WARMING)
    for column in look.columns("heat"):
        hours = float(_quiet(look, column)[-1])
        within = warmer[-int(hours - _WARMING + 1) :] if hours >= _WARMING else warmer[:0]
        if np.nanmax(within, initial=0.0) > _MUCH:
            yield METER_DEAD, column, hours


def _quiet(look: Look, column: int) -> Array:
    """For how many hours a meter has told of no heat, at each slot from the first of the reference on."""
    values = np.concatenate([look.past[:, column], look.new[:, column]])
    highest = np.nanmax(look.past[:, column], initial=0.0)
    heated = np.cumsum(np.abs(values) > 0.02 * highest).astype(np.float64)
    return np.asarray(_same(np.where(np.isnan(values), np.nan, heated)) * look.step)


def _far(look: Look) -> Found:
    """A room that is heated where it was never heated before and has warmed more than that explains, or whose day is
    colder than ever with the heating as usual."""
    day = look.slots(24.0)
    heat = list(look.columns("heat"))
    if not heat or len(look.past) < 3 * day:
        return
    channels = np.concatenate([look.past, look.new])
    known = len(look.past)
    power = np.abs(channels[:, heat]).sum(axis=1)
    heated = power > 0.02 * np.nanmax(power[:known], initial=0.0)
    warmest = np.nanmax(channels[:known, 0][heated[:known]], initial=-np.inf)
    lately = channels[-day:, 0][heated[-day:]]
    if np.isfinite(warmest) and (lately > warmest + _LEAST_JUMP).sum() >= look.slots(3.0):
        found = look.response
        if found is not None and np.nanmax(unexplained(found, _WARMING)[-24:], initial=0.0) > _SOME:
            yield SENSOR_DRIFTS, 0, 24.0
            return
    room, heating = _means(channels[:, 0], day), _means(power, day)
    usual = np.nanmedian(heating[:known])
    if room[-1] < np.nanmin(room[:known], initial=np.inf) - 2.0 and 0.9 * usual < heating[-1] < 1.2 * usual:
        yield SENSOR_DRIFTS, 0, 24.0


def _means(values: Array, slots: int) -> Array:
    """The mean of the last `slots` values at each place; NaN where half of them are missing."""
    known = ~np.isnan(values)
    sums = np.cumsum(np.concatenate([[0.0], np.where(known, values, 0.0)]))
    counts = np.cumsum(np.concatenate([[0], known]))
    means = np.full(len(values), np.nan)
    number = counts[slots:] - counts[:-slots]
    means[slots - 1 :] = np.where(number > slots / 2, (sums[slots:] - sums[:-slots]) / np.maximum(number, 1), np.nan)
    return means


def _delayed(look: Look) -> Found:
    """A meter that tells what it measured an hour ago."""
    found = look.response
    if found is None:
        return
    for column in look.columns("heat"):
        if lateness(found, column):
            yield METER_LATE, column, 24.0


_TESTS: tuple[Callable[[Look], Found], ...] = (_stuck, _leaps, _turned, _amounts, _silent, _far, _delayed)
