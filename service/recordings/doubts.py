"""What looks wrong with telemetry before anything is learned from it, for `check`, `learn` and `tg.fit`, which write
the remedy in different places."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adapters.fields.durations import format_duration
from adapters.reading import Fault
from estimator.arrays import Array
from estimator.heat.terms import sun_channel
from service.config.site import ZoneConfig
from service.config.usual import usual
from service.recordings.samples import Recorded
from service.zone.alignment import SETPOINT, unit_of

_FEW_DAYS = 3.0
"""Days below which a history is too short to learn walls from."""
_SMALL_POWER = 40.0
"""W that the heating of a zone does not stay below: such numbers are in kW."""
_RESTLESS = 1.5
"""How much more a room may vary than the outdoors before the two look swapped."""
_FEW_VALUES = 100
"""Values of a channel below which nothing is said of it."""
_MONTHS, _LAST_SWAPPED = 45, 12
"""Days after which a recording has days beyond this one of a month."""
_BRIGHT = 100.0
"""W/m2 from which irradiance tells where the sun is."""
_FAR_OFF = 0.75
"""h between noon and the middle of the day's sun: the equation of time and windows of one facade explain less."""
_TEMPERATURES = {"degF": (5 / 9, -160 / 9), "K": (1.0, -273.15)}
"""Units that are taken for degC by mistake: scale and offset to it."""
_MUCH = 0.05
"""Share of the readings that are refused from which on it is no accident."""
_UNUSED = 0.2
"""Share of the intervals that nothing can be made of from which on it is no accident."""
_REFUSED = {
    Fault.OUT_OF_RANGE: "its unit, its scale and the range `valid`",
    Fault.OUT_OF_ORDER: "the order of its rows",
    Fault.DUPLICATED: "rows with the same time, of which one is used",
    Fault.NON_NUMERIC: "its decimal sign and delimiter",
    Fault.NAIVE_TIMESTAMP: 'the time zone of its times, such as zone = "Europe/Berlin" in `timestamp`',
    Fault.BAD_TIMESTAMP: "the format and the time zone of its times",
}
"""What to look at, by the kind of most that was refused."""


class Remedies(NamedTuple):
    """How to write what a recording needs."""

    unit: Callable[[str, str], str]
    """Of the channel and the unit that it is in."""
    dates: str
    """How dates are read that begin with the day."""
    zone: str


IN_A_CONFIGURATION = Remedies(
    lambda channel, unit: f'unit = "{unit}"', 'format = "%d.%m.%Y %H:%M" for 31.12.2025 23:45', 'zone = "Europe/Berlin"'
)


def doubts(zone: ZoneConfig, found: Recorded, remedies: Remedies = IN_A_CONFIGURATION) -> list[str]:
    """One sentence with a remedy for each thing that looks wrong in what was `found` of `zone`."""
    refused = list(_of_refused(found))
    if not found.samples:
        return refused
    times, values = found.times, found.values
    return [
        *refused,
        *_of_length(times),
        *_of_dates(times[np.isfinite(values).any(axis=1)], remedies),
        *_of_gaps(zone, times, values),
        *_of_clock(zone, times, values, remedies),
        *_of_channels(zone, found, remedies),
        *_of_swaps(zone, values),
    ]


def _of_refused(found: Recorded) -> Iterator[str]:
    if (count := sum(found.refused.values())) > _MUCH * found.readings:
        most = max(found.refused, key=lambda fault: found.refused[fault])
        look = _REFUSED.get(Fault(most), "what the source delivers")
        yield f"{100 * count / max(count, found.readings):.0f} % of it is refused, most as {most}; look at {look}"


def _of_length(times: Array) -> Iterator[str]:
    days = (times[-1] - times[0]) / 86400 if len(times) else 0.0
    if days < _FEW_DAYS:
        yield f"it covers {days:.1f} days; the walls of a building show after about a week, so give more if you can"


def _of_dates(times: Array, remedies: Remedies) -> Iterator[str]:
    """Day and month in each other's place leave only the 1st to the 12th of each month."""
    days = np.unique(times // 86400).astype(np.int64)
    in_month = [int(str(day)[-2:]) for day in days.astype("datetime64[D]")]
    if len(days) and days[-1] - days[0] > _MONTHS and max(in_month) <= _LAST_SWAPPED:
        yield (
            "all of it is on the 1st to 12th of a month, as if day and month were swapped; write how times are to be "
            f"read, such as {remedies.dates}"
        )


def _of_gaps(zone: ZoneConfig, times: Array, values: Array) -> Iterator[str]:
    """Readings that come only when something has changed leave intervals that nothing bridges."""
    network, outputs = zone.network, len(zone.network.measured)
    known: npt.NDArray[np.bool_] = np.isfinite(values)
    aged = []
    for name, measured in zip(network.inputs, known[:, outputs:].T, strict=True):
        own = zone.channels[name].max_age
        keys = "hold_inputs" if own is None else "max_age"
        aged.append((name, f'{keys} = "1d"', _age(times, measured), zone.hold_inputs if own is None else own))
    room, day = np.asarray(known[:, :outputs].any(axis=1)), round(86400 / zone.period)
    aged.append((network.measured[0], f"max_gap = {day}", _age(times, room), zone.max_gap * zone.period))
    for name, remedy, age, longest in aged:
        # What comes after the last reading is an end, not a pause.
        (measured,) = np.nonzero(age == 0.0)
        share = float((age[: measured[-1] + 1] > longest).mean()) if len(measured) else 0.0
        if share > _UNUSED:
            yield (
                f"{share:.0%} of its intervals are not used, for {name} has had no reading for more than "
                f"{format_duration(longest)}; write {remedy} if it is recorded only when it changes"
            )


def _age(times: Array, measured: npt.NDArray[np.bool_]) -> Array:
    """(L,): time since the last sample that was `measured` (L,) [s]; infinite before the first."""
    return times - np.maximum.accumulate(np.where(measured, times, -np.inf))


def _of_clock(zone: ZoneConfig, times: Array, values: Array, remedies: Remedies) -> Iterator[str]:
    """The sun tells the time, where it is measured and the site has a longitude."""
    location, channel = zone.whereabouts.location, sun_channel(zone.network)
    if location is None or channel is None:
        return
    sun = np.nan_to_num(values[:, zone.network.channels.index(channel)])
    if (sun > _BRIGHT).sum() < _FEW_VALUES:
        return
    moment = np.angle((sun * np.exp(2j * np.pi * times / 86400)).sum()) / (2 * np.pi)
    late = 24.0 * ((moment - 0.5 + location.longitude / 360.0 + 0.5) % 1.0 - 0.5)
    if abs(late) > _FAR_OFF:
        yield (
            f"{channel} is highest {abs(late):.1f} h {'after' if late > 0 else 'before'} noon at longitude "
            f"{location.longitude:g}; write the time zone of the recording, such as {remedies.zone}, or correct "
            "the longitude"
        )


def _of_channels(zone: ZoneConfig, found: Recorded, remedies: Remedies) -> Iterator[str]:
    network, channels = zone.network, dict(zone.channels)
    told = dict(zip(network.channels, found.values.T, strict=True))
    if zone.setpoint is not None:
        channels[SETPOINT] = zone.setpoint
        told[SETPOINT] = np.array([sample.setpoint for sample in found.samples])
    for name, column in told.items():
        known, unit = column[np.isfinite(column)], unit_of(network, name)
        if len(known) < _FEW_VALUES:
            continue
        lower, upper = usual(network, name, channels[name])
        middle = float(np.median(known))
        if known.min() == known.max() and name not in (*network.heat_channels, SETPOINT):
            yield f"{name} is {middle:g} {unit} all the time; is its sensor connected?"
        elif unit == "degC" and not lower <= middle <= upper:
            scaled = {one: scale * middle + offset for one, (scale, offset) in _TEMPERATURES.items()}
            meant = [one for one, value in scaled.items() if lower <= value <= upper]
            remedy = (
                f"write {remedies.unit(name, meant[0])} if it is in {meant[0]}"
                if meant
                else "look at its unit and scale"
            )
            yield f"{name} is {middle:.1f} degC in the middle, usual are {lower:g} to {upper:g}; {remedy}"
        elif unit == "W" and known.max() == known.min() == 0.0:
            yield f"{name} is 0 W all the time: a model then does not learn what heating does"
        elif unit == "W" and 0.0 < np.abs(known).max() < _SMALL_POWER:
            yield f"{name} is {np.abs(known).max():g} W at most; write {remedies.unit(name, 'kW')} if it is in kW"
        elif unit == "W" and np.abs(known).mean() > upper:
            mean = f"{name} is {np.abs(known).mean():.0f} W on average, more than {upper:g} is unusual"
            yield f"{mean}; look at its unit, or give it a range `valid`"


def _of_swaps(zone: ZoneConfig, values: Array) -> Iterator[str]:
    """The room and the outdoors in each other's place: outdoors the temperature varies more."""
    network = zone.network
    outdoors = [name for name in network.boundaries if name.startswith("T_out")]
    if not outdoors:
        return
    room, outside = values[:, 0], values[:, network.channels.index(outdoors[0])]
    both = np.isfinite(room) & np.isfinite(outside)
    if both.sum() >= _FEW_VALUES and room[both].std() > _RESTLESS * outside[both].std() > 0.0:
        inner, outer = room[both].std(), outside[both].std()
        yield f"{network.measured[0]} varies by {inner:.1f} K and {outdoors[0]} by {outer:.1f} K; are the two swapped?"
