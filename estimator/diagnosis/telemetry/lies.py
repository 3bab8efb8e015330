"""What of the telemetry cannot be believed: each channel against its own fortnight, and the room against all of them.

The reference is what was measured until two days ago, or until the oldest suspicion began. A suspicion stands until the
channel behaves as in the reference again, or until too little reference is left: then what was suspected is the new
normal. All limits are multiples of what the reference has shown: a coarse or a noisy sensor is judged by itself.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from estimator.arrays import HOUR, Array
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
from estimator.diagnosis.telemetry.recent import Recent, begins, slot, until, without
from estimator.diagnosis.telemetry.response import Response, gathered, response
from estimator.network.network import Network
from estimator.thermostat.memory import Memory, setpoints

EVERY = 3600
"""s between two looks at the telemetry."""

_RECENT = 48 * HOUR
"""s that do not belong to the reference: what is found later than that was taken for true meanwhile."""

_LEAST = 7.0
"""Days of reference before anything is suspected: a week, of whose days none is like another."""

_LEAST_JUMP = 1.0
"""K."""

_EXPLAINED = 0.15
"""K/h: warming that nothing explains up to this is usual in any room."""

_WARMING, _SOME = 6.0, 0.6
"""h over which warming that nothing explains is looked at, and the share of the largest that the reference has seen."""

_SUDDEN = 0.6
"""Share of a jump that comes in one slot."""

_ALOFT = 2.0
"""h in which a sudden rise takes back a sudden fall."""

_TOO_WARM = 1.5
"""K h by which a room is heated where it was never heated before, until that tells of a drift."""

_ALIKE = 0.3
"""Share of a leap by which the one back may be larger or smaller."""

_HEATED, _LEAST_HEATED = 0.02, 2.0
"""Share of the largest power from which a room is heated, and h of it without which nothing is said of its heat."""

_ENOUGH = 6.0
"""h of times alike whose largest step says how large one can be."""

_SURE = {UNIT_CHANGED: 4.0, METER_LATE: 25.0, METER_DEAD: 8.0}
"""Log-likelihood ratio from which something is suspected, and _ABOVE times what has gathered in the reference."""
_ABOVE = 1.5
_STANDING = 0.5
"""Of both, the share down to which a suspicion stands: what wavers about its limit would come and go."""
_NEVER = 1e3
_SPREAD = np.linspace(0.05, 0.95, 10)
"""Quantiles of the usual heat, which stand for what a dead meter does not tell."""

_BEYOND = 0.25
"""Share of the range of the reference by which it may be warmer or colder around the room than ever."""

_STILL_WARM = 3.0
"""h."""

_TURNED = 6.0
"""h after which a day must still be upside down: a front turns one for a while."""

_LATELY = 12.0
"""h in which spikes count."""

SETTLED = 7 * 24.0
"""h after which another level is the usual one, and what was suspected is the new truth: what was learned of it is
kept."""

Truths = npt.NDArray[np.bool_]

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
    setpoints: Array
    """(m + k,): what the thermostat was set to [degC]; NaN where nobody told."""
    stood: frozenset[tuple[str, int]]
    """Name and channel of what was suspected before."""

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


def looked(
    network: Network, recent: Recent, before: tuple[Suspicion, ...], time: float, memory: Memory
) -> tuple[Suspicion, ...]:
    """What is suspected at `time` [UTC s], when these stood `before` and `memory` is what the thermostat was told."""
    rows, step = until(recent, time), slot(recent) / HOUR
    # What begins with a leap begins between two slots.
    onset = min([time - _RECENT, *(one.since - slot(recent) for one in before)])
    split = len(rows) - min(len(rows), round((time - onset) / slot(recent)))
    if np.isfinite(rows[:split, 0]).sum() * step < _LEAST * 24.0:
        return ()
    of = kinds(network)
    told = setpoints(memory, begins(recent, time))
    since = {(one.name, one.column): one.since for one in before}
    look = Look(of, step, rows[:split], rows[split:], response(rows, split, of), told, frozenset(since))
    found = {(name, column): hours for test in _TESTS for name, column, hours in test(look)}
    # Channels that have changed places are no other riddle.
    if any(name == CHANNELS_SWAPPED for name, _ in found):
        found = {key: hours for key, hours in found.items() if key[0] == CHANNELS_SWAPPED}
    # Of a heat that is told wrongly, a room knows more than its inputs.
    if any(of[column] == "heat" for _, column in found):
        found = {key: hours for key, hours in found.items() if key in since or key not in _UNEXPLAINED}
    return tuple(
        Suspicion(name, column, since.get((name, column), time - hours * HOUR))
        for (name, column), hours in found.items()
    )


def believed(
    network: Network, recent: Recent, before: tuple[Suspicion, ...], now: tuple[Suspicion, ...], time: float
) -> Recent:
    """`recent` without the temperatures told while they were suspected, `before` but no longer `now` at `time` [UTC s]:
    they are no reference. What has been told for SETTLED is the new truth, and stays."""
    of, suspected = kinds(network), {one.column for one in now}
    for one in before:
        ended = one.column not in suspected and time - one.since < SETTLED * HOUR
        if ended and of[one.column] in ("room", "outside"):
            columns = [0, one.column] if one.name == CHANNELS_SWAPPED else [one.column]
            recent = without(recent, columns, one.since)
    return recent


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


def finding(network: Network, one: Suspicion) -> Finding:
    """The finding that `one` of the suspicions is."""
    channel = (network.measured[0], *network.inputs)[one.column]
    return Finding(one.name, channel, _SENTENCES[one.name].format(channel=channel))


def among(findings: tuple[Finding, ...], network: Network, suspicions: tuple[Suspicion, ...]) -> tuple[Finding, ...]:
    """`findings` with those of the `suspicions` in place of earlier ones about the telemetry."""
    told = (finding(network, one) for one in sorted(suspicions, key=lambda one: TELEMETRY.index(one.name)))
    return (*told, *(one for one in findings if one.finding not in TELEMETRY))


_UNEXPLAINED = ((SENSOR_JUMPED, 0), (SENSOR_DRIFTS, 0))
"""What is suspected of a room that warms as its inputs do not explain."""

Found = Iterator[tuple[str, int, float]]
"""Name, channel, and for how many hours."""


def _stuck(look: Look) -> Found:
    """A thermometer whose value has stayed the same for longer than ever."""
    for column in look.columns("room", "outside"):
        if (hours := float(_stuck_for(look, column)[-1])) > 0.0:
            yield SENSOR_STUCK, column, hours


def _stuck_for(look: Look, column: int) -> Array:
    """(k,): for how many hours a thermometer has told the same at each new slot; 0 if no longer than ever."""
    hours = _same(np.concatenate([look.past[:, column], look.new[:, column]])) * look.step
    return np.where(hours > max(2.0, 3.0 * hours[: len(look.past)].max()), hours, 0.0)[len(look.past) :]


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
    steps = np.diff(look.new[:, column])
    if not (np.abs(steps) > _LEAST_JUMP).any():
        return [], 0
    limits = _largest(look, column)
    standing: list[int] = []
    spikes = 0
    for place in np.flatnonzero(np.abs(steps) > limits).tolist():
        while standing and abs(steps[standing[-1]]) < 0.5 * abs(steps[place]):
            standing.pop()
        if standing and steps[place] * steps[standing[-1]] < 0.0:
            lately = (len(steps) - place) * look.step <= _LATELY
            spikes += (place - standing.pop()) * look.step <= 1.0 and lately
        else:
            standing.append(place)
    over = _over(look, column)
    found = []
    for place in standing:
        before = _middle(look.new[max(place - look.slots(0.5), 0) : place + 1, column])
        after = _middle(look.new[place + 1 : place + 1 + look.slots(0.5), column])
        # A window cools a room by and by; a sensor tells another level from one slot to the next.
        sudden = abs(steps[place]) > _SUDDEN * abs(after - before)
        if sudden and abs(after - before) > 0.6 * abs(steps[place]) and not over[place]:
            found.append(_Jump(place, before, after))
    return found, spikes


def _over(look: Look, column: int) -> Truths:
    """(k - 1,): steps between two new slots with which a lie begins that is over, or ends: another one goes back, or
    they lead to where the thermometer was in the reference from where it was stuck or never was."""
    past, new = look.past[:, column], look.new[:, column]
    steps = np.diff(new)
    lowest, highest = np.nanmin(past, initial=np.inf), np.nanmax(past, initial=-np.inf)
    strange = (new < lowest - _LEAST_JUMP) | (new > highest + _LEAST_JUMP)
    usual = (new >= lowest) & (new <= highest)
    ends = (strange[:-1] & usual[1:]) | (_stuck_for(look, column)[:-1] > 0.0)
    large = np.abs(steps) > _LEAST_JUMP
    back = np.abs(steps[:, None] + steps[large]) < _ALIKE * np.abs(steps[:, None])
    return np.asarray(ends | back.any(axis=1))


def _largest(look: Look, column: int) -> Array:
    """(k - 1,): what a step of a thermometer between two new slots must exceed: twice the largest of times of the
    reference that were heated, or were not, alike; infinite where the reference has hardly any such times."""
    values = np.concatenate([look.past[:, column], look.new[:, column]])
    heated, unseen = np.zeros(len(values) - 1, dtype=np.int64), np.zeros(len(look.new), dtype=np.bool_)
    for meter in look.columns("heat"):
        quiet = _quiet(look, meter)
        heated |= (quiet[1:] == 0.0) | (quiet[:-1] < 1.0)
        # Nobody knows what a heat that the reference never saw does in its first hour, as after a summer.
        unseen |= _above(look, meter)
    sizes, split = np.abs(np.diff(values)), len(look.past)
    largest = []
    for which in (0, 1):
        known = sizes[: split - 1][heated[: split - 1] == which]
        largest.append(2.0 * _highest(known) if len(known) > look.slots(_ENOUGH) else np.inf)
    return np.where(unseen[1:], np.inf, np.maximum(_LEAST_JUMP, np.array(largest)[heated[split:]]))


def _above(look: Look, column: int) -> Truths:
    """(k,): new slots in whose last hour a meter has told more than ever in the reference."""
    above = np.abs(look.new[:, column]) > 1.5 * _highest(look.past[:, column])
    return np.convolve(above, np.ones(look.slots(1.0) + 1))[: len(above)] > 0.0


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
                # Then the shape of the last day says whether it is still so.
                if hours <= 24.0 + _TURNED:
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
    day, later = look.slots(24.0), look.slots(_TURNED)
    for column in look.columns("outside"):
        past, new = look.past[:, column], look.new[:, column]
        whole = past[len(past) % day :].reshape(-1, day)
        if len(whole) < 4 or len(new) < day + later or np.isnan(new[-day:]).mean() > 0.2:
            continue
        # A room next door has no day of its own, but it is never as far below zero as it was above.
        before, now, spread = np.nanmean(past), np.nanmean(new[-day:]), np.nanstd(past)
        if not abs(now + before) <= abs(now - before) + 2.0 * spread:
            continue
        counts = (~np.isnan(whole)).sum(axis=0)
        # An hour that is never measured, as where every sample of it is refused, stays unknown.
        usual = np.nansum(whole, axis=0) / np.where(counts, counts, np.nan)
        share = _STANDING if (SIGN_FLIPPED, column) in look.stood else 1.0
        least = share * min(-0.35, 1.5 * float(_slopes(usual[None], whole).min()))
        # The reference ends when the new rows begin: their first slot is the one after a whole day.
        ends = len(new) - later, len(new)
        shapes, days = [np.roll(usual, -end % day) for end in ends], [new[end - day : end] for end in ends]
        if float(_slopes(np.array(shapes), np.array(days)).max()) < least:
            yield SIGN_FLIPPED, column, 24.0


def _slopes(shapes: Array, values: Array) -> Array:
    """(d,): how strongly each row of `values` (d, k) follows its shape of a day (d, k) beside a straight line."""
    known = ~np.isnan(values) & ~np.isnan(shapes)
    counts = np.maximum(known.sum(axis=1, keepdims=True), 1)

    def centred(rows: Array) -> Array:
        rows = np.where(known, rows, 0.0)
        return np.where(known, rows - rows.sum(axis=1, keepdims=True) / counts, 0.0)

    # What a line leaves of the shape, by which the values are weighed (Frisch and Waugh 1933).
    line, left = centred(np.linspace(-1.0, 1.0, values.shape[1])), centred(shapes)
    steepness = np.maximum((line * line).sum(axis=1, keepdims=True), 1e-12)
    left = left - line * (line * left).sum(axis=1, keepdims=True) / steepness
    square = (left * left).sum(axis=1)
    found = (left * np.where(known, values, 0.0)).sum(axis=1) / np.maximum(square, 1e-12)
    return np.where((counts[:, 0] > 3) & (square > 1e-12), found, 0.0)


def _misread(look: Look) -> Found:
    """Meters in whose place another one would explain the room better: one that tells a thousand times as much or a
    thousandth, the same an hour earlier, or some of the usual heat where this one tells of none."""
    found = look.response
    if found is None:
        return
    hour, unseen = look.slots(1.0), _unseen(look)
    for column in look.columns("heat"):
        told, usual, highest = _heat(found, column)
        if not len(usual) > look.slots(_LEAST_HEATED) or found.effect(column) * highest < found.scale:
            continue
        least, earlier = np.quantile(usual, 0.1), np.concatenate([told[hour:], np.full(hour, np.nan)])
        for name, other in ((UNIT_CHANGED, told * 1000.0), (UNIT_CHANGED, told / 1000.0), (METER_LATE, earlier)):
            # No noise of a heater that is off, and no first heat after a summer of noise, is like the usual heat.
            like = (np.abs(other) >= least) & (np.abs(other) <= 1.5 * highest)
            values = np.where(like, other, told) if name == UNIT_CHANGED else other
            if (hours := _evident(look, partial(_instead, found, unseen, column, values), name, column)) is not None:
                yield name, column, hours
        quiet, heated = np.abs(told) <= _HEATED * highest, told > _HEATED * highest
        if not quiet[-1]:
            continue
        # A room that is warmer than it was ever heated to needs no heat; what warms it from there on is none.
        room = found.rows[:, 0]
        idle = room > _highest(room[: found.known][heated[: found.known]])
        needless = np.append(False, idle[:-1])
        hours = _evident(look, partial(_silently, found, unseen | needless, column, quiet), METER_DEAD, column)
        silent, warming = float(_quiet(look, column)[-1]), look.slots(_WARMING)
        if hours is None and silent > _WARMING:
            warmer = _means(np.where(idle, np.nan, found.errors), warming)
            within = warmer[-max(1, look.slots(silent) - warming) :]
            usually = max(_highest(warmer[: found.known]), _EXPLAINED * look.step)
            # What warmed the room where it needed no heat, such as people in the evening, may do so where it is colder.
            ever = _highest(_means(found.errors[: found.known], warming))
            hours = silent if _highest(within) > max(_ABOVE * usually, ever) else None
        if hours is not None:
            yield METER_DEAD, column, max(hours, silent)


def _instead(found: Response, unseen: Truths, column: int, values: Array, begin: int) -> Array:
    """(n - begin,): log-likelihood ratios, from slot `begin` on, of `values` (n,) in place of what a meter tells."""
    better = found.log_likelihood(found.errors_if(column, values, begin))
    return np.where(unseen[begin:], 0.0, better - found.log_likelihood(found.errors[begin:]))


def _silently(found: Response, unseen: Truths, column: int, quiet: Truths, begin: int) -> Array:
    """The same of the usual heat, as often as usual, where a meter is `quiet` (n,); it never is where it tells of
    heat."""
    errors, (_, usual, _) = found.errors[begin:], _heat(found, column)
    often = len(usual) / np.isfinite(found.rows[: found.known, column]).sum()
    heats = found.effect(column) * np.quantile(usual, _SPREAD)
    ratios = found.log_likelihood(errors[:, None] - heats) - found.log_likelihood(errors[:, None])
    ratios = np.log1p(often * (np.exp(ratios).mean(axis=1) - 1.0))
    return np.where(quiet[begin:], np.where(unseen[begin:], 0.0, ratios), -_NEVER)


def _unseen(look: Look) -> Truths:
    """(n,): slots in which it is far warmer or colder around the room, against the room, than ever in the reference:
    how it answers that, nobody knows."""
    rows = np.concatenate([look.past, look.new])
    apart = rows[:, list(look.columns("outside"))] - rows[:, :1]
    past = apart[: len(look.past)]
    lowest, highest = np.nanmin(past, axis=0, initial=np.inf), np.nanmax(past, axis=0, initial=-np.inf)
    beyond = _BEYOND * (highest - lowest)
    return np.asarray(((apart < lowest - beyond) | (apart > highest + beyond)).any(axis=1))


def _negative(look: Look) -> Found:
    """A meter that tells negative heat for the first time, and no other."""
    for column in look.columns("heat"):
        past, new = look.past[:, column], look.new[:, column]
        highest = _highest(past)
        told = new[np.abs(new) > 0.05 * highest]
        if highest > 0.0 and np.nanmin(past, initial=0.0) >= -0.01 * highest and len(told) and (told[-3:] < 0.0).all():
            yield SIGN_FLIPPED, column, float(len(new) - np.argmax(new < -0.05 * highest)) * look.step


def _heat(found: Response, column: int) -> tuple[Array, Array, float]:
    """What a meter tells (n,), what of the reference is heat (m,), and the largest of that."""
    told = found.rows[:, column]
    past, highest = told[: found.known], _highest(told[: found.known])
    return told, past[past > _HEATED * highest], highest


def _highest(values: Array) -> float:
    """The largest of `values` that are known, at least 0."""
    return float(np.nanmax(values, initial=0.0))


def _evident(look: Look, ratios: Callable[[int], Array], name: str, column: int) -> float | None:
    """For how many hours the log-likelihood `ratios`, from any of n slots on, have spoken for a suspicion; None where
    they do not, or not more than is usual in the reference."""
    day, split = look.slots(24.0), len(look.past)
    share = _STANDING if (name, column) in look.stood else 1.0
    sure, above = share * _SURE[name], share * _ABOVE
    # The last day speaks for itself in nearly every look: all of the fortnight then need not be heard.
    if not gathered(ratios(max(split + len(look.new) - day, 0)), day)[-1] > sure:
        return None
    evidence = gathered(ratios(0), day)
    if not evidence[-1] > max(sure, above * evidence[:split].max()):
        return None
    begun = np.flatnonzero(evidence == 0.0)
    return float(len(evidence) - 1 - begun[-1] if len(begun) else day) * look.step


def _warm(look: Look) -> Found:
    """A room that is heated where it was never heated before, and has warmed as its inputs do not explain: at once, or
    by and by; or whose day is colder than ever with the heating as usual."""
    day, heat, found = look.slots(24.0), list(look.columns("heat")), look.response
    if not heat or found is None:
        return
    known, room = found.known, found.rows[:, 0]
    power = np.abs(found.rows[:, heat]).sum(axis=1)
    highest = _highest(power[:known])
    heated = (power > _HEATED * highest) & (power < 1.5 * highest)
    felt = max(found.effect(column) * _heat(found, column)[2] for column in heat) > found.scale
    if not felt or heated[:known].sum() < look.slots(_LEAST_HEATED):
        return
    # Where a window is opened, a room is heated when it is colder than at the beginning of the slot.
    level = np.fmin(room, np.append(room[1:], np.nan)) - _wanted(look, heated)
    above = np.where(heated, level - np.nanmax(level[:known][heated[:known]], initial=-np.inf), -np.inf)
    # Where a window is closed, a room warms at once to what it was.
    leaps = np.cumsum(np.where(np.abs(found.errors) > _LEAST_JUMP / 2.0, found.errors, 0.0))
    rises = leaps - np.fmax.reduce(_latest(leaps, look.slots(_ALOFT) + 1)[:, :-1], axis=1)
    usual, hour = _highest(rises[:known]), look.slots(1.0)
    # Until it is as warm as usual, a room that is heated tells nothing of its thermometer.
    telling = np.flatnonzero(heated & (level >= np.nanmedian(level[:known][heated[:known]])))
    for place in np.flatnonzero(rises[known:] > max(_LEAST_JUMP, _SOME * usual)) + known:
        before, after = _middle(room[max(place - 3, 0) : place]), _middle(room[place : place + 3])
        # A party warms a room by and by; a sensor tells another level from one slot to the next.
        step, hours = room[place] - room[place - 1], float(len(room) - place) * look.step
        if not _SUDDEN * step < after - before < step / _SUDDEN:
            continue
        # What falls as suddenly within two hours was somebody who cooked.
        if leaps[place : place + look.slots(_ALOFT)].min() < leaps[place - 1] + _ALIKE * found.errors[place]:
            continue
        strong = step > max(_LEAST_JUMP, _ABOVE * usual)
        high = above[telling[telling >= place]] > 0.5 * (after - before)
        if high.sum() >= hour / 2 or len(high) >= 2 * hour:
            stands = (strong or high.sum() >= hour / 2) and high[-2 * hour :].any()
        else:
            stands = strong and hours > 1.0 and (hours <= 24.0 or (SENSOR_JUMPED, 0) in look.stood)
        if stands:
            yield SENSOR_JUMPED, 0, hours
            return
    warm = above[-day:][above[-day:] > _LEAST_JUMP].sum() * look.step >= _TOO_WARM
    if warm and (above[telling[-2 * hour :]] > _LEAST_JUMP).any():
        warmer = _means(found.errors, look.slots(_WARMING))
        if _highest(warmer[-day:]) > _SOME * max(_highest(warmer[:known]), _EXPLAINED * look.step):
            yield SENSOR_DRIFTS, 0, 24.0
            return
    daily, heating = _means(room, day), _means(power, day)
    usual = np.nanmedian(heating[:known])
    if (
        usual > _HEATED * highest
        and daily[-1] < np.nanmin(daily[:known], initial=np.inf) - 2.0
        and 0.9 * usual < heating[-1] < 1.2 * usual
    ):
        yield SENSOR_DRIFTS, 0, 24.0


def _wanted(look: Look, heated: Truths) -> Array:
    """(n,): what the room is heated to [degC]; 0 where that is not known while it is `heated` (n,). A heater is still
    warm for a while after the thermostat has been set back."""
    told = look.setpoints
    if np.isnan(told[heated]).mean() > 0.1:
        return np.zeros(len(told))
    return np.asarray(np.fmax.reduce(_latest(told, look.slots(_STILL_WARM)), axis=1))


def _latest(values: Array, slots: int) -> Array:
    """(n, slots): the last so many of `values` (n,) at each place; NaN before the first."""
    return sliding_window_view(np.concatenate([np.full(slots - 1, np.nan), values]), slots)


def _means(values: Array, slots: int) -> Array:
    """The mean of the last `slots` values at each place; NaN where half of them are missing."""
    known = ~np.isnan(values)
    sums = np.cumsum(np.concatenate([[0.0], np.where(known, values, 0.0)]))
    counts = np.cumsum(np.concatenate([[0], known]))
    means = np.full(len(values), np.nan)
    number = counts[slots:] - counts[:-slots]
    means[slots - 1 :] = np.where(number > slots / 2, (sums[slots:] - sums[:-slots]) / np.maximum(number, 1), np.nan)
    return means


def _quiet(look: Look, column: int) -> Array:
    """For how many hours a meter has told of no heat, at each slot from the first of the reference on."""
    values = np.concatenate([look.past[:, column], look.new[:, column]])
    heated = np.cumsum(np.abs(values) > _HEATED * _highest(look.past[:, column])).astype(np.float64)
    return np.asarray(_same(np.where(np.isnan(values), np.nan, heated)) * look.step)


_TESTS: tuple[Callable[[Look], Found], ...] = (_stuck, _leaps, _turned, _negative, _misread, _warm)
