"""Answers about a room that look back: how long warming up took, what an open window cost, why forecasts were wrong."""

from collections.abc import Iterator
from datetime import UTC, datetime

import numpy as np
import numpy.typing as npt

from adapters.timestamps import time_zone
from estimator.arrays import DAY, HOUR, Array
from estimator.diagnosis.finding import amount
from estimator.statespace.inverse import known_heat, missing_heat
from service.forecast.answers import RoomAnswer
from service.forecast.learned import model_draws
from service.zone.worker import ZoneWorker

_KWH = 3.6e6
_LEAD = 6 * 3600
"""s ahead at which forecasts are judged: as far as a room is heated ahead."""
_ENOUGH = 6
"""Verified forecasts of the last day before they say anything."""
_WRONG = 0.5
"""K by which forecasts may be off without a reason being told."""
_SMALL, _UNLIKE = 0.35, 1.5
"""K by which they may be off in any case, and the multiple of what is usual from which a smaller error has a reason."""
_EXPLAINED = 0.6
"""Share of the error that is left once heating and weather are known, up to which these explain it."""
_UNUSUAL = 0.5
"""Standard deviations of an input from what is usual at the hour, on the mean of a day, that are worth a word."""
_OFTEN = 0.1
"""Share of the time from which heat is lost too often for an open window."""
_DRAWS = 64
"""Of the posterior, whose mean is the model that tells how much heat was lost."""
_AROUND = 6 * 3600
"""s before and after an interval in which heat was lost with which it is compared."""
_SURE = 1.96 * 1.4826
"""Half of a 95 % interval, as a multiple of the median absolute deviation."""
_NOTED = 0.05
"""kWh of lost heat that are worth a sentence."""


def warming_up(step: float, temperature: Array, setpoint: Array, cold: float) -> Iterator[RoomAnswer]:
    """How long the room was more than `cold` [K] below its set-point after a rise, by `temperature` and `setpoint` (K,)
    [degC] of intervals of `step` s: not if another follows, or nothing is measured, before it is warm."""
    with np.errstate(invalid="ignore"):
        changes = np.diff(setpoint)
        rises, falls = (np.flatnonzero(change > cold) + 1 for change in (changes, -changes))
    # Within an interval the set-point may be on its way: its mean rises twice.
    rises = rises[np.diff(rises, prepend=-2) > 1]
    took, missed = [], 0
    for rise in rises.tolist():
        end = min([later for later in (*rises, *falls) if later > rise + 1], default=len(setpoint))
        after = temperature[rise:end]
        warm = np.flatnonzero(after >= setpoint[min(rise + 1, end - 1)] - cold)
        if not np.isfinite(after[: warm[0] if len(warm) else None]).all():
            continue
        if len(warm):
            took.append(float(warm[0]) * step / HOUR)
        elif end in falls:
            missed += 1
    if not took:
        return
    usual, most = float(np.median(took)), max(took)
    parts = ["After a setback it was warm again at once"]
    if usual == 0.0 < most:
        parts = [f"After most setbacks it was warm again at once, else after at most {most:.1f} h"]
    elif most > 0.0:
        parts = [f"After a setback it took {usual:.1f} h to be warm again, at most {most:.1f} h"]
        parts.append("start heating so long before it is to be warm")
    if missed:
        parts.append(f"{missed} of {missed + len(took)} times it was not warm before the next setback")
    yield RoomAnswer("warming_up", "; ".join(parts), "h", usual)


def often_lost(gain: Array) -> bool:
    """Whether heat that nobody measures, `gain` (K, 3) [W], is lost for certain so often that it is not windows and
    people but something that the model does not know, such as a colder room next door."""
    return bool((gain[:, 2] < 0.0).mean() > _OFTEN)


def likely_lost(gain: Array) -> npt.NDArray[np.bool_]:
    """(K,): where heat that nobody measures, `gain` (K, 3) [W], was likely lost, and none came."""
    with np.errstate(invalid="ignore"):
        lost: npt.NDArray[np.bool_] = (gain[:, 1] < 0.0) & (gain[:, 2] <= 0.0)
    return lost


def needed_heat(worker: ZoneWorker, times: Array, step: float, temperature: Array, inputs: Array) -> Array:
    """(K,): heat [W] that nobody measures, without that of the sun, with which the learned room follows its
    `temperature` (K,) [degC] under `inputs` (K, n_u), from each of the intervals of `step` s at `times` [UTC s] to the
    next. The filter expects little of such heat, and tells about half of what a window takes.
    """
    standing = worker.standing
    assert standing is not None
    draws = model_draws(worker, standing, _DRAWS)
    known, network = known_heat(draws, worker.network, worker.loop.driving, times, inputs), draws.network
    known[:, len(network.inputs) :] *= [term.name.startswith("sun") for term in network.terms]
    return missing_heat(draws, times, step, temperature, known)


def lost_heat(times: Array, step: float, gain: Array, zone: str | None, needed: Array) -> Iterator[RoomAnswer]:
    """The heat that was lost, and that nobody measures, as through an open window.

    `gain` (K, 3) [W] has the .025, .5 and .975 quantiles of unmeasured heat in the intervals of `step` s that begin at
    `times` (K,) [UTC s]: they tell when, and how sure it is, and `needed` (K,) [W] how much. `zone` is the IANA name of
    the local time. Errors of one loss are taken to err together. A loss that was certain at some time counts from when
    to when it was likely, and the interval before: a filter is sure only after a while. It is what more heat was needed
    than in the hours around it, for people, and what the model has wrong, are much the same then, and as unsure as this
    was then.
    """
    if not np.isfinite(gain).any():
        return
    with np.errstate(invalid="ignore"):
        lost, likely = gain[:, 2] < 0.0, likely_lost(gain)
    if often_lost(gain):
        sentence = (
            "What an open window took away is not known, for heat that nobody measures comes and goes "
            f"{100.0 * lost.mean():.0f} % of the time"
        )
        yield RoomAnswer("window", sentence, "kWh")
        return
    next_to = np.diff(times) < 1.5 * step
    likely[:-1] |= likely[1:] & next_to
    follows = np.concatenate([[False], likely[1:] & likely[:-1] & next_to])
    number = np.cumsum(likely & ~follows)
    lost = likely & np.isin(number, number[lost])
    energy = np.zeros((len(times), 3))
    for k in np.flatnonzero(lost).tolist():
        around = needed[~lost & (np.abs(times - times[k]) <= _AROUND)]
        usual = np.median(around) if len(around) else 0.0
        astray = _SURE * np.median(np.abs(around - usual)) if len(around) else 0.0
        # .975, .5 and .025 quantile of the gain: the least, the likely and the most that was lost.
        away = gain[k, 1] - gain[k, ::-1]
        energy[k] = (usual - needed[k] + np.sign(away) * np.hypot(away, astray)) * step / _KWH
    low, most_likely, high = energy.sum(axis=0).tolist()
    days = len(times) * step / DAY
    if most_likely < _NOTED:
        sentence = f"No open window was noticed in {days:.1f} days"
        yield RoomAnswer("window", sentence, "kWh", most_likely, low, high)
        return
    each = np.bincount(number, energy[:, 1])
    most = int(np.argmax(each))
    part = "all" if (number[lost] == most).all() else f"{spoken_energy(float(each[most]))} kWh"
    inside = times[lost & (number == most)]
    begin, end = spoken_stretch(inside[0], inside[-1] + step, zone)
    least, about, largest = map(spoken_energy, (low, most_likely, high))
    sentence = (
        f"An open window, or something else that nobody measures, took away about {about} kWh in {days:.1f} days, "
        f"compared with the hours around it; 95 % between {least} and {largest} kWh; {part} of it from {begin} to {end}"
    )
    yield RoomAnswer("window", sentence, "kWh", most_likely, low, high)


def spoken_stretch(begin: float, end: float, zone: str | None) -> tuple[str, str]:
    """UTC s as the clocks of the time zone show them, without the day where it is the same."""
    local = UTC if zone is None else time_zone(zone)
    first, last = (datetime.fromtimestamp(when, local) for when in (begin, end))
    return f"{first:%Y-%m-%d %H:%M}", f"{last:%H:%M}" if first.date() == last.date() else f"{last:%Y-%m-%d %H:%M}"


def spoken_energy(kwh: float) -> str:
    """As people write an energy, which nobody knows to the watt-hour."""
    return amount(float(f"{round(kwh, 2):.2g}"))


def last_day(worker: ZoneWorker, times: Array, step: float, inputs: Array, gain: Array) -> Iterator[RoomAnswer]:
    """How far the forecasts of the last day were off 6 h ahead as they were issued, and why; `inputs` (K, n_u) and
    `gain` (K,) [W], unmeasured, are of the intervals of `step` s that begin at `times` [UTC s]."""
    skill = worker.skill()
    if skill is None:
        return
    known = {one.lead: one for one in skill.over(1)}
    issued = [one for one in skill.issued_over(1) if one.forecasts >= _ENOUGH and one.lead in known]
    if not issued:
        return
    one = min(issued, key=lambda each: abs(each.lead - _LEAD))
    parts = [f"In the last day the forecasts {one.lead / HOUR:g} h ahead were off by {one.rmse:.1f} K"]
    week = next(each for each in skill.issued_over(7) if each.lead == one.lead)
    if week.forecasts > one.forecasts:
        parts.append(f"{week.rmse:.1f} K is usual")
    if one.rmse > _WRONG or one.rmse > max(_SMALL, _UNLIKE * week.rmse):
        left = known[one.lead].rmse
        if left <= _EXPLAINED * one.rmse:
            parts.append(
                "mostly because heating or weather came otherwise than foreseen, for with both known it would have "
                f"been {left:.1f} K"
            )
            parts += _departed(worker, times, inputs)
        elif why := _unmeasured(times, gain):
            parts.append(why)
        elif one.rmse > _WRONG:
            parts.append("heating and weather do not explain it, so the model does not know this room well enough")
    yield RoomAnswer("last_day", "; ".join(parts), "K", one.rmse)


def _departed(worker: ZoneWorker, times: Array, inputs: Array) -> Iterator[str]:
    """The input that departed most from what is usual at the hour."""
    network, found = worker.network, []
    for channel, values in zip(network.inputs, inputs.T, strict=True):
        known = values[np.isfinite(values)]
        spread, away = float(known.std()) if len(known) else 0.0, _against_usual(times, values)
        if spread > 0.0 and abs(away) > _UNUSUAL * spread:
            found.append((abs(away) / spread, channel, away))
    if found:
        _, channel, away = max(found)
        side = "above" if away > 0.0 else "below"
        unit = network.channel_unit(channel).replace("degC", "K")
        yield f"{_called(channel)} was {float(f'{abs(away):.2g}'):g} {unit} {side} what is usual at the hour"


def _called(channel: str) -> str:
    """An input in the words of people who have no model."""
    kinds = {
        "T_out": "the outdoor temperature",
        "I_sol": "the sun",
        "cloud_cover": "the cloud cover",
        "u_heat": "the heating",
    }
    return next((words for kind, words in kinds.items() if channel.startswith(kind)), channel)


def _unmeasured(times: Array, gain: Array) -> str:
    """How heat that nobody measures explains an error; empty where it does not."""
    away = _against_usual(times, gain) * DAY / _KWH
    if away > 10.0 * _NOTED:
        return f"people, or something else that nobody measures, brought {spoken_energy(away)} kWh more than usual"
    if away < -10.0 * _NOTED:
        # How much a window took is told by itself: here it would be less the heat of people who stayed away.
        return "an open window took heat away, or people brought less than usual"
    return ""


def _against_usual(times: Array, values: Array) -> float:
    """How much more the mean of the last day is than that of the days before at the same hours; 0 if unknown."""
    new, hour = times > times[-1] - DAY, (times % DAY // HOUR).astype(np.int64)
    means = []
    for part in (new, ~new):
        chosen = part & np.isfinite(values)
        count = np.bincount(hour[chosen], minlength=24)
        with np.errstate(invalid="ignore"):
            means.append(np.bincount(hour[chosen], values[chosen], minlength=24) / count)
    away = means[0] - means[1]
    return float(np.nanmean(away)) if np.isfinite(away).any() else 0.0
