"""How a room does, in the words of the people who run it: the answers that page, report and notebooks open with.

One computation for all three: from what was measured in a period (`Past`), and from what the zone's worker has learned.
Sentences are parts that "; " joins, each of which the page and the report have in other languages.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from math import ceil, floor
from typing import Literal, NamedTuple, Self

import numpy as np

from adapters.timestamps import time_zone
from estimator.arrays import Array, Mask
from estimator.bank.bank import by_physics
from estimator.diagnosis import finding as kinds
from estimator.diagnosis.finding import Diagnosis, Finding, amount
from estimator.network.assembly import assemble
from estimator.network.discretise import heat_loss
from estimator.network.network import Network
from estimator.network.presets import NEIGHBOUR
from service.forecast.answers import Room, RoomAnswer, ToDo
from service.forecast.heating import COLD
from service.forecast.looking_back import (
    last_day,
    likely_lost,
    lost_heat,
    needed_heat,
    often_lost,
    spoken_energy,
    spoken_stretch,
    warming_up,
)
from service.forecast.shares import Shares
from service.records.outlook import Weather
from service.records.series import GAIN, Series
from service.records.trust import TRUSTED, UNTRUSTED, Trust
from service.zone.worker import Standing, ZoneWorker

WARM = 1.0
"""K above the highest set-point of a week from which on a room is too warm: none that cools down in a setback is."""
BAND = (20.0, 26.0)
"""degC within which a room without a set-point is comfortable: category II of EN 16798-1, sedentary work."""
RARE = 0.05
"""Share of the time for which a room may be too cold or too warm and still counts as comfortable."""
MOST = 3
"""Things to do that are shown."""
_TOLD = 1.0
"""h too cold or too warm of which the longest stretch is told."""
_HOUR, _DAY, _WEEK = 3600.0, 86400.0, 7 * 86400.0
_COOLING = 6
"""h over which a room is left to cool down."""
_SHORTEST = 10
"""s: with shorter periods these hours are thousands of steps, whose simulation takes seconds."""
_FELT = 0.05
"""K from which a change of temperature is told."""
_LEVELS = (0.025, 0.5, 0.975)
_FULL, _LITTLE = 0.9, 0.1
"""Shares of the largest heating from which it is at its limit, and up to which it hardly heats."""
_MOSTLY = 0.3
"""Share of the energy from which what 1 K less would save is no small change any more."""
_WIDE = 3.0
"""Upper over lower end of an interval from which what lies between says too little to be relied upon."""
_WORTH = 20.0
"""W of heat from elsewhere that are worth a sentence."""


class Past(NamedTuple):
    """K intervals of `step` s that were measured, oldest first; NaN where nothing was."""

    times: Array
    """(K,) UTC s."""
    step: float
    temperature: Array
    """(K,) degC, of the first output."""
    setpoint: Array
    """(K,) degC."""
    gain: Array
    """(K, 3) W that nobody measures, as the estimator infers it, at _LEVELS."""
    inputs: Array
    """(K, n_u) in the network's units."""

    @classmethod
    def of(cls, series: Series) -> Self:
        """A stretch of history."""
        y, setpoint = (series.means[name] for name in ("y", "setpoint"))
        gain = np.column_stack([series.means[name] for name in GAIN])
        return cls(series.times.astype(np.float64), float(series.bucket), y, setpoint, gain, series.inputs)


class RoomQuestion(NamedTuple):
    """Asks how a room with a floor of `area` [m2] (NaN: unknown) and clocks of `zone` (IANA; None: UTC) did in `past`;
    the power of its heating at full was `entered`, as for a valve, or measured."""

    past: Past
    area: float = float("nan")
    zone: str | None = None
    entered: bool = False

    def __call__(self, worker: ZoneWorker, weather: Weather, given_up: Callable[[], bool]) -> Room | None:
        """The answers; None before the first sample."""
        standing = worker.standing
        if standing is None or not len(self.past.times):
            return None
        loss = _loss(worker)
        elsewhere = _Elsewhere.of(worker, self.past)
        hours = _local_hours(self.past.times + self.past.step / 2.0, self.zone)
        sun, people = (_by_hour(heat[:, 1], hours) for heat in elsewhere)
        comfort = Comfort.of(self.past)
        diagnosis, trust = worker.diagnosis(), worker.trust
        metered, shares = _metered(worker.network, self.past, standing), Shares.of(worker)
        doubt = _doubt(diagnosis, loss, metered)
        own = self.past.inputs * shares.medians
        times, step, needed = self.past.times, self.past.step, self.past.gain[:, 1]
        if np.isfinite(needed).any():
            needed = needed_heat(worker, times, step, self.past.temperature, self.past.inputs)
        answers = [
            comfort.answer(self.past, self.zone),
            self._entered(
                _loss_answer(loss, self.area, doubt, any(one.startswith(NEIGHBOUR) for one in _beside(worker.network)))
            ),
            *(_pace(worker, standing) if metered else ()),
            *warming_up(self.past.step, self.past.temperature, self.past.setpoint, COLD),
            _heat_answer(elsewhere, sun, people, metered),
            *map(self._entered, _energy(worker, self.past, shares, loss, doubt)),
            *lost_heat(times, step, self.past.gain, self.zone, needed),
            *last_day(worker, times, step, own, needed),
        ]
        warming = next((one.value for one in answers if one.about == "warming_up"), 0.0)
        heat = _heating(worker.network)
        use = _Use(
            partial(_share, np.nansum(self.past.inputs[:, heat], axis=1), standing.carried.record.largest[heat].sum()),
            partial(_share, _cooling(worker.network, self.past).sum(axis=1), 0.0),
        )
        told = [*for_the_model(diagnosis, trust), *_for_comfort(comfort, self.past, warming, use)]
        return Room(
            days=len(self.past.times) * self.past.step / _DAY,
            answers=tuple(answers),
            sun=tuple(sun.tolist()),
            people=tuple(people.tolist()),
            to_do=tuple(sorted(told, key=lambda one: one.urgency)[:MOST]),
        )

    def _entered(self, answer: RoomAnswer) -> RoomAnswer:
        """`answer` in W or kWh, saying so where it hangs on a power that was entered."""
        if not self.entered or not np.isfinite(answer.value):
            return answer
        return replace(answer, sentence=f"{answer.sentence}; as right as the power that was entered for the valve")


class Comfort(NamedTuple):
    """Where it was too cold and too warm (K,), of the intervals that were measured."""

    cold: Mask
    warm: Mask
    measured: Mask
    hours: float
    """Of each interval."""
    against_setpoint: bool

    @classmethod
    def of(cls, past: Past) -> Self:
        setpoint = bool(np.isfinite(past.setpoint).any())
        lower, upper = (np.full(len(past.times), limit) for limit in BAND)
        if setpoint:
            lower = past.setpoint - COLD
            upper = highest(past.setpoint, past.step) + WARM
        with np.errstate(invalid="ignore"):
            cold, warm = past.temperature < lower, past.temperature > upper
        return cls(cold, warm, np.isfinite(past.temperature), past.step / _HOUR, setpoint)

    def share(self, where: Mask) -> float:
        return float(where.sum() / max(1, self.measured.sum()))

    @property
    def often(self) -> Literal["", "cold", "warm"]:
        """What it often was, too "cold" or too "warm"; empty where it was comfortable."""
        cold, warm = self.share(self.cold), self.share(self.warm)
        return "" if max(cold, warm) <= RARE else "cold" if cold >= warm else "warm"

    @property
    def hours_of(self) -> tuple[float, float, float]:
        """h in which it was too cold, and too warm, and that were measured."""
        cold, warm, measured = (float(part.sum()) * self.hours for part in (self.cold, self.warm, self.measured))
        return cold, warm, measured

    def answer(self, past: Past, zone: str | None) -> RoomAnswer:
        cold, warm, all_hours = self.hours_of
        verdict = f"Often too {self.often}" if self.often else "Comfortable"
        measure = (
            f"too cold is more than {COLD:g} K below the set-point, too warm more than {WARM:g} K above the highest of "
            "a week"
            if self.against_setpoint
            else f"no set-point is known, so comfortable is {BAND[0]:g} to {BAND[1]:g} °C"
        )
        told = map(_whole, (cold, warm, all_hours))
        parts = ["{}: {} h too cold and {} h too warm of {} h".format(verdict, *told)]
        if max(cold, warm) >= _TOLD:
            longest = _longest(past.times, past.step, self.warm if warm > cold else self.cold)
            begin, end = spoken_stretch(past.times[longest][0], past.times[longest][-1] + past.step, zone)
            low, high = (extreme(past.temperature[longest]) for extreme in (np.min, np.max))
            parts.append(
                f"longest too warm from {begin} to {end}, up to {high:.1f} °C"
                if warm > cold
                else f"longest too cold from {begin} to {end}, down to {low:.1f} °C"
            )
        return RoomAnswer("comfort", "; ".join([*parts, measure]), "h", cold + warm)


def _whole(hours: float) -> int:
    """As the page rounds them: half hours up."""
    return floor(hours + 0.5)


def _longest(times: Array, step: float, where: Mask) -> slice:
    """The longest run of intervals `where` something was so, each of which begins where the one before ends."""
    breaks = np.flatnonzero(~(where[1:] & where[:-1] & (np.diff(times) < 1.5 * step))) + 1
    runs = zip((0, *breaks.tolist()), (*breaks.tolist(), len(where)), strict=True)
    begin, end = max((run for run in runs if where[run[0]]), key=lambda run: run[1] - run[0])
    return slice(begin, end)


def highest(setpoint: Array, step: float) -> Array:
    """(K,): the highest set-point of the last week, or, in the first, of all of it."""
    found = _highest(setpoint, step, _WEEK)
    first = max(1, round(_WEEK / step))
    found[:first] = np.fmax.reduce(setpoint[:first])
    return found


def _highest(setpoint: Array, step: float, over: float) -> Array:
    """(K,): the highest set-point in the `over` s up to each interval; NaN where there was none."""
    width = max(1, round(over / step))
    highest, size = setpoint.copy(), 1
    while size < width:
        # Of so many intervals each; two that overlap are as many as both reach over.
        further = min(size, width - size)
        highest[further:] = np.fmax(highest[further:], highest[:-further])
        size += further
    return highest


def _after_a_rise(past: Past) -> Mask:
    """(K,): where the set-point is higher than it was at some time in the last hours."""
    with np.errstate(invalid="ignore"):
        rose: Mask = past.setpoint > -_highest(-past.setpoint, past.step, _COOLING * _HOUR) + COLD
    return rose


def _loss(worker: ZoneWorker) -> Array | None:
    """(3,): heat loss to outdoors [W/K] at _LEVELS, with NaN for the ends of a collapsed interval; None if it is not
    known.

    With neighbours, or a supply of heat, it is that of the room with all of them as warm as itself. It grows with every
    conductance (Rayleigh's monotonicity law) where no wall is both theirs and the outdoors', so that the ends of all
    parameters give an interval that is, if anything, too wide.
    """
    summary, network = worker.parameters(_LEVELS), worker.network
    if summary is None or not np.isfinite(summary.heat_loss[1]):
        return None
    if not _beside(network):
        return summary.heat_loss
    known = np.where(np.isfinite(summary.parameters), summary.parameters, summary.parameters[:, 1:2])
    matrices, node = assemble(network, known), network.nodes.index(network.measured[0])
    shares = np.linalg.solve(matrices.internal, matrices.inputs)[:, node, : len(network.boundaries)]
    outdoors = [channel not in _beside(network) for channel in network.boundaries]
    loss: Array = heat_loss(matrices, node) * shares[:, outdoors].sum(axis=1)
    return np.where(np.isfinite(summary.heat_loss), loss, np.nan)


def _beside(network: Network) -> tuple[str, ...]:
    """The boundaries that are no outdoor air, where one is."""
    others = tuple(channel for channel in network.boundaries if not channel.startswith("T_out"))
    return others if len(others) < len(network.boundaries) else ()


def _metered(network: Network, past: Past, standing: Standing) -> bool:
    """Whether heating or cooling was ever measured."""
    heat = _heating(network)
    known = standing.carried.record.largest[heat].any() or np.nan_to_num(past.inputs[:, heat]).any()
    return bool(known or _cooling(network, past).any())


def _doubt(diagnosis: Diagnosis, loss: Array | None, metered: bool) -> str:
    """Why the heat loss should not be believed; empty where it may."""
    found = {one.finding for one in diagnosis.findings if one.subject == "heat_loss"}
    if kinds.AGAINST_BALANCE in found:
        return "do not rely on it, for it contradicts the energy that was used"
    if kinds.MEMBERS_DISAGREE in found:
        return "do not rely on it, for models of the room disagree"
    if loss is not None and not np.isfinite(loss[0]):
        return "how sure this is, is not known"
    if loss is not None and loss[2] > _WIDE * loss[0]:
        return "do not rely on it yet"
    return "" if metered else "do not rely on it, for no heating was measured"


def _loss_answer(loss: Array | None, area: float, doubt: str, neighbours: bool) -> RoomAnswer:
    if loss is None:
        return RoomAnswer("heat_loss", "Its heat loss is not known, for the estimator knows no building", "W/K")
    low, median, high = loss.tolist()
    parts = [f"It loses {amount(median)} W for each K that it is warmer than outside"]
    if high > _WIDE * low:
        parts = ["How much heat it loses is hardly known yet"]
    if neighbours:
        parts.append("the rooms next door counted as being as warm")
    if np.isfinite(low):
        parts.append(f"95 % between {amount(low)} and {amount(high)} W/K")
    if np.isfinite(area) and not high > _WIDE * low:
        parts.append(f"{median / area:.2g} W/K for each m² of floor")
    return RoomAnswer("heat_loss", "; ".join([*parts, *([doubt] if doubt else [])]), "W/K", median, low, high)


def _pace(worker: ZoneWorker, standing: Standing) -> Iterator[RoomAnswer]:
    """How fast the room cools down and heats up from now on, neither sun nor people heating it."""
    network, period, held = worker.network, worker.period, standing.carried.held.values
    heat = _heating(network)
    if worker.progress.stalled or not np.isfinite(held).all() or not heat or period < _SHORTEST:
        return
    off = np.where([network.channel_unit(channel).startswith("W") for channel in network.inputs], 0.0, held)
    full = off.copy()
    full[heat] = standing.carried.record.largest[heat]
    hour, hours = max(1, ceil(_HOUR / period)), max(1, ceil(_COOLING * _HOUR / period))
    # Neither sun nor people, and heating that is off or full: nothing that is usual helps.
    state = by_physics(worker.estimator, standing.state)
    issue, terms = worker.estimator.issue(state, 64), (0, len(network.terms))
    cold, warm = (
        [
            mixture.quantiles(np.array(_LEVELS), 0)
            for mixture in worker.estimator.unfold(issue, np.tile(np.pad(row, terms), (steps, 1))).each()
        ]
        for row, steps in ((off, hours), (full, hour))
    )
    fall = cold[0][1] - cold[-1][::-1]
    if fall[1] < _FELT:
        sentence = f"Without heating, sun and people it would not cool down in {_COOLING} h at the weather of now"
    else:
        sure = f"95 % between {fall[0]:.1f} and {fall[2]:.1f} K" if fall[0] >= _FELT else f"at most {fall[2]:.1f} K"
        sentence = (
            f"Without heating, sun and people it cools by {fall[1]:.1f} K in {_COOLING} h at the weather of now; {sure}"
        )
    yield RoomAnswer("cooling", sentence, "K", *fall[[1, 0, 2]].tolist())
    power, rise = float((full * Shares.of(worker).medians)[heat].sum()), float(warm[-1][1] - cold[hour][1])
    if power > 0.0 and rise >= _FELT:
        sentence = f"An hour of full heating ({amount(power)} W) makes it {rise:.1f} K warmer than an hour without"
        yield RoomAnswer("heating", sentence, "K", rise)


def _heating(network: Network) -> list[int]:
    """The inputs that are heating power [W]."""
    heats = {
        heat.channel
        for heat in network.heat_inputs
        if heat.unit == "W" and (heat.gain.parameter is not None or heat.gain.constant > 0.0)
    }
    return [place for place, channel in enumerate(network.inputs) if channel in heats]


def _cooling(network: Network, past: Past) -> Array:
    """(K, n_u): heat [W] that each input took away."""
    power, takes = np.nan_to_num(past.inputs), np.zeros_like(past.inputs)
    for heat in network.heat_inputs:
        if heat.unit == "W":
            place = network.inputs.index(heat.channel)
            negative = heat.gain.parameter is None and heat.gain.constant < 0.0
            takes[:, place] = np.maximum(power[:, place] if negative else -power[:, place], 0.0)
    return takes


class _Use(NamedTuple):
    """Mean heating and cooling power while something was so, each as a share of the largest; 0 without any."""

    heated: Callable[[Mask], float]
    cooled: Callable[[Mask], float]


class _Elsewhere(NamedTuple):
    """(K, 3) W that the sun brought, and people and appliances (what nobody measures), at _LEVELS. What passes evens
    out over the days, and the coefficients of each err together, which no interval is narrower for."""

    sun: Array
    people: Array

    @classmethod
    def of(cls, worker: ZoneWorker, past: Past) -> Self:
        sun, habits = np.zeros((2, len(past.times), 3))
        summary, network = worker.parameters(_LEVELS), worker.network
        if summary is not None and len(summary.coefficients):
            inputs = np.where(np.isfinite(past.inputs), past.inputs, 0.0)
            drive = worker.loop.driving(past.times, inputs)[:, len(network.inputs) :]
            for term, coefficients, known in zip(network.terms, summary.coefficients, drive.T, strict=True):
                if np.isfinite(coefficients).all():
                    heat = sun if term.name.startswith("sun") else habits
                    heat += np.outer(known, coefficients)
        # Without what is inferred at each time; and what also takes heat away, and often, is not people.
        usual = np.isnan(past.gain[:, 1:2]) | often_lost(past.gain)
        # The gain has the heat of habits in it.
        return cls(sun, np.where(usual, habits, past.gain[:, 1:2] + habits - habits[:, 1:2]))


def _local_hours(times: Array, zone: str | None) -> Array:
    """(K,): hour of the day, 0 to 23."""
    local = UTC if zone is None else time_zone(zone)
    return np.array([datetime.fromtimestamp(when, local).hour for when in times.tolist()], dtype=np.int64)


def _by_hour(heat: Array, hours: Array) -> Array:
    """(24,): mean of `heat` [W] in each hour of the day; NaN for an hour that is not there."""
    count = np.bincount(hours, minlength=24)
    with np.errstate(invalid="ignore"):
        found: Array = np.bincount(hours, heat, minlength=24) / count
    return found


def _heat_answer(elsewhere: _Elsewhere, sun: Array, people: Array, metered: bool) -> RoomAnswer:
    low, mean, high = (elsewhere.sun + elsewhere.people).mean(axis=0).tolist()
    parts = []
    inside = "people and appliances" if metered else "people, appliances and heating that nobody measures"
    for name, heat in (("the sun", sun), (inside, people)):
        if np.isfinite(heat).any() and np.nanmax(heat) >= _WORTH:
            hour = int(np.nanargmax(heat))
            parts.append(
                f"heat from {name}: {np.nanmean(heat):.0f} W on average, {np.nanmax(heat):.0f} W around {hour}:30"
            )
    if not parts:
        return RoomAnswer("other_heat", "No heat besides the heating is known", "W", mean)
    if high > low:
        sure = f"95 % between {low:.0f} and {high:.0f} W on average"
        parts.append(f"both together, {sure}" if len(parts) > 1 else sure)
    sentence = "; ".join(parts)
    return RoomAnswer("other_heat", sentence[0].upper() + sentence[1:], "W", mean, low, high)


def _energy(worker: ZoneWorker, past: Past, shares: Shares, loss: Array | None, doubt: str) -> Iterator[RoomAnswer]:
    """What the heating used, or in a room that was only cooled the cooling, and what 1 K less, or more, would have
    saved: the loss of 1 K, but no more than a day used."""
    heat = _heating(worker.network)
    heated, cooled = np.zeros_like(past.inputs), _cooling(worker.network, past)
    heated[:, heat] = np.maximum(np.nan_to_num(past.inputs[:, heat]), 0.0)
    cooling = cooled.any() and not heated.any()
    metered = (cooled if cooling else heated) * past.step / 3.6e6
    days = (past.times // _DAY).astype(np.int64)
    used = np.bincount(days - days[0], metered @ shares.medians)
    low, total, high = (shares.quantiles @ metered.sum(axis=0)).tolist()
    if total <= 0.0:
        sentence = "What 1 K less would have saved is not known, for no heating was measured"
        yield RoomAnswer("saving", sentence, "kWh")
        return
    span = f"{amount(total)} kWh in {len(past.times) * past.step / _DAY:.1f} days"
    parts = [f"The cooling used {span}" if cooling else f"The heating used {span}"]
    bounds = (low, high) if low < high else ()
    if bounds:
        parts.append(f"95 % between {amount(low)} and {amount(high)} kWh")
    yield RoomAnswer("energy", "; ".join(parts), "kWh", total, *bounds)
    one = "1 K more" if cooling else "1 K less"
    if loss is None or "rely" in doubt:
        yield RoomAnswer("saving", f"What {one} would have saved is not known, for the heat loss is not", "kWh")
        return
    hours = np.bincount(days - days[0]) * past.step / _HOUR
    low, saved, high = (float(np.minimum(each * hours / 1000.0, used).sum()) for each in loss)
    if saved > _MOSTLY * total:
        why = "the room was hardly cooled" if cooling else "mostly other heat keeps the room warm"
        yield RoomAnswer("saving", f"What {one} would have saved is not known, for {why}", "kWh")
        return
    parts = [f"{one} would have saved about {spoken_energy(saved)} kWh ({100.0 * saved / total:.0f} %)"]
    if np.isfinite(low):
        parts.append(f"95 % between {spoken_energy(low)} and {spoken_energy(high)} kWh")
    yield RoomAnswer("saving", "; ".join(parts), "kWh", saved, low, high)


_FROM_FINDINGS = dict.fromkeys(kinds.TELEMETRY, -1) | {
    kinds.CALLS_WITHOUT_HEAT: 0,
    kinds.IMPLAUSIBLE: 1,
    kinds.HEAT_WITHOUT_CALL: 2,
    kinds.AGAINST_BALANCE: 4,
    kinds.MISSES_SOMETHING: 5,
    kinds.TAKEN_FOR_CLEAR: 5,
}
"""Findings that call for something to be done, and how urgent that is; the others are for who reads parameters."""
_NO_CONTROLLER = "do not let a controller rely on the forecasts yet"


def _for_comfort(comfort: Comfort, past: Past, warming: float, use: _Use) -> Iterator[ToDo]:
    """What to do about an uncomfortable room that is usually warm `warming` h after a setback, 0 if unknown."""
    cold, warm = (3.5, 3.0) if comfort.often == "warm" else (3.0, 3.5)
    if comfort.share(comfort.cold) > RARE:
        yield ToDo(*_against_cold(comfort, past, warming, use.heated(comfort.cold)), cold)
    if comfort.share(comfort.warm) > RARE:
        yield ToDo(*_against_warmth(comfort, use.heated(comfort.warm), use.cooled(comfort.warm)), warm)


def for_the_model(diagnosis: Diagnosis, trust: Trust) -> Iterator[ToDo]:
    """What to do about telemetry, heating and model; with what an uncomfortable room needs it is all of `to_do`."""
    for one in _grouped(diagnosis.findings):
        problem, _, remedy = one.sentence.partition("; ")
        yield ToDo(remedy, problem, float(_FROM_FINDINGS[one.finding]))
    told = {one.sentence for one in diagnosis.findings}
    untrusted = [one.reason for one in trust.horizons if one.level == UNTRUSTED]
    if untrusted:
        # What follows from a finding is mended with it.
        if untrusted[0] not in told:
            yield ToDo(_NO_CONTROLLER, untrusted[0], 4.5)
    elif trust.beaten and not any(one.verified == one.issued == TRUSTED for one in trust.horizons):
        yield ToDo(_NO_CONTROLLER, trust.beaten.split("; ")[0], 4.5)


def _against_cold(comfort: Comfort, past: Past, warming: float, heated: float) -> tuple[str, str]:
    reason = f"it was too cold for {_whole(float(comfort.cold.sum()) * comfort.hours)} h"
    lost = likely_lost(past.gain) & (not often_lost(past.gain))
    risen = comfort.cold & ~lost & _after_a_rise(past)
    if comfort.share(comfort.cold & lost) > comfort.share(comfort.cold) / 2.0:
        return "keep the windows shut while it is heated", f"{reason}; mostly while heat was lost that nobody measures"
    if comfort.share(comfort.cold & ~lost & ~risen) <= RARE / 2.0:
        earlier = f"{warming:.1f} h earlier" if warming > 0.0 else "earlier"
        hours = _whole(float(risen.sum()) * comfort.hours)
        return f"start heating {earlier}", f"it was too cold for {hours} h after a setback"
    if heated > _FULL:
        return "have the heating looked at, or lower the set-point", f"{reason} at full heating"
    if comfort.against_setpoint:
        return "look for what keeps the heating from following the set-point, such as a closed valve", reason
    return "heat more, or connect the set-point of the room", reason


def _against_warmth(comfort: Comfort, heated: float, cooled: float) -> tuple[str, str]:
    hours = _whole(float(comfort.warm.sum()) * comfort.hours)
    if heated > _LITTLE:
        reason = f"it was too warm for {hours} h while it was heated"
        return "lower the heating or look for a valve that does not close", reason
    if cooled > _FULL:
        return "shade the windows, or have the cooling looked at", f"it was too warm for {hours} h at full cooling"
    if cooled > 0.0:
        return "look for what keeps the cooling from following the set-point", f"it was too warm for {hours} h"
    return "shade the windows or air", f"it was too warm for {hours} h without much heating"


def _share(power: Array, most: float, when: Mask) -> float:
    """Mean of `power` (K,) [W] `when` something was so, as a share of its largest or `most`; 0 without any."""
    largest = max(float(most), float(power.max(initial=0.0)))
    return float(power[when].mean()) / largest if largest > 0.0 and when.any() else 0.0


def _grouped(findings: Sequence[Finding]) -> list[Finding]:
    """One finding of each kind that calls for something to be done."""
    first: dict[str, Finding] = {}
    for one in findings:
        if one.finding in _FROM_FINDINGS:
            first.setdefault(one.finding, one)
    return sorted(first.values(), key=lambda one: kinds.FINDINGS.index(one.finding))
