"""A controller that heats zones as cheaply as comfort allows, over Thermogate's REST API.

    python mpc.py --url http://127.0.0.1:8080 --zone living --heater u_heat --power 2000 --low 20 --high 23
    python mpc.py --zone living=3000 bedroom=1500 --limit 1200 --cop 2.6@-7 3.4@2 4.2@7

The second line heats two zones of 3,000 and 1,500 W by one heat pump that takes at most 1,200 W: its heat per watt
depends on how cold it is outdoors.

It asks for the trust in the zone's forecasts and for forecasts under two plans, plans the heating by a linear
programme, and prints what to do now. Between two plans it holds the planned temperature. Where the forecasts cannot be
trusted, or no answer comes, it is a thermostat; where nothing is measured, it does what it planned or did before. It
needs NumPy and SciPy. Writing the power to the plant is yours: Thermogate never writes.
"""

from __future__ import annotations

import argparse
import http.client
import itertools
import json
import math
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from datetime import datetime
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag, toeplitz
from scipy.optimize import linprog

Array = npt.NDArray[np.float64]
Ask = Callable[[str, str, Any], Any]
"""Method, path and body (None for none) to the JSON that answers; OSError or ValueError if there is no answer."""

Known = Callable[[int], Mapping[str, Mapping[str, Sequence[float]]]]
"""What you know better than Thermogate of as many steps as asked for: by zone and input, one value for each step."""

HOUR = 3600.0
SHORTEST = HOUR
"""Below this horizon in s there is nothing to plan."""
ROUNDS = 3
"""How often the first plan is made anew around the forecast under the one before; later ones begin from the last."""
PULSE, FIRST_GUESS = 0.2, 0.2
"""Shares of the heater's power: what is tried more or less in the first step, and what the first plan begins from."""
LOOK = 300.0
"""s between two looks at the room: a thermostat switches, and a plan is held."""
BLIND = 3600.0
"""s before a measurement is lost in which it may have been wrong already, as that of a sensor that is stuck."""
DAY = 86400.0
FAILURES = (OSError, ValueError, LookupError, TypeError)
"""Of Thermogate and of plans, after which a thermostat heats."""
DISCOMFORT = 100.0
"""What a kelvin outside the comfort band costs for an hour, in the currency of the price."""


def _setting(meaning: str, default: Any) -> Any:
    """A setting with what it is, for --help."""
    return field(default=default, metadata={"meaning": meaning})


@dataclass(frozen=True)
class Settings:
    """What is controlled and how; prices are per kWh. `sure` is 1.64 for a 90 % interval, and counts twice where
    forecasts are doubtful."""

    zone: str
    heater: str = _setting("the input that is planned", "u_heat")
    power: float = _setting("the heater's largest power, W", 2000.0)
    low: float = _setting("lower end of the comfort band, degC", 20.0)
    high: float = _setting("its upper end, degC", 23.0)
    step: float = _setting("from one plan to the next, s", 900.0)
    horizon: float = _setting("how far a plan reaches at most, s", 86400.0)
    differential: float = _setting("between the thermostat's switching on and off, K", 0.3)
    sure: float = _setting("standard deviations of the forecast that a plan stays inside the comfort band", 1.64)


class Decision(NamedTuple):
    """The power [W] until the next decision, who decided, why, and the planned powers and temperatures. For `held`: the
    first step begins at `start`, UTC s; `path` [degC] is planned at its beginning and after each period of the zone;
    the plan keeps `low` [degC] in it, and a watt over the step moves the room by `per_watt` K."""

    power: float
    by: str
    reason: str
    plan: Array = np.empty(0)
    temperatures: Array = np.empty(0)
    start: float = math.nan
    path: Array = np.empty(0)
    low: float = math.nan
    per_watt: float = math.nan


class Forecast(NamedTuple):
    """Of a zone under a plan: mean and standard deviation (m + 1,) [degC, K] at the beginning and after each of m
    periods of the zone, how many of them are a step of the plan, and the valid time."""

    mean: Array
    sd: Array
    every: int
    valid_time: str


class Plant(NamedTuple):
    """What heats all rooms."""

    limit: float = math.inf
    """W that it may take, for all rooms together."""
    cop: Sequence[tuple[float, float]] = ((0.0, 1.0),)
    """Outdoor temperatures [degC], ascending, each with W of heat for each W taken; straight lines lie between them.
    By default it heats with what it takes."""
    outdoor: str = "T_out"
    """The input that is the outdoor temperature."""

    def heat_per_watt(self, outdoor: Array) -> Array:
        """The coefficient of performance at temperatures `outdoor` [degC]."""
        return np.asarray(np.interp(outdoor, *zip(*self.cop, strict=True)), dtype=float)


DIRECT = Plant()
"""Heaters that share nothing."""


class Room(NamedTuple):
    """A room that is to be heated now; see `decide`."""

    settings: Settings
    temperature: float
    heating: bool
    low: Callable[[int], Sequence[float]] | None = None
    before: Array | None = None

    def lowest(self, steps: int) -> Array:
        """(n,): the lower end of comfort in the steps to come [degC]."""
        return np.array(self.low(steps) if self.low is not None else [self.settings.low] * steps)


class View(NamedTuple):
    """How a room is planned."""

    steps: int
    trust: str
    why: str
    """No further."""


class Wish(NamedTuple):
    """What a plan of n steps is to bring about in a room."""

    moved: Array
    """(n, n): what a W in each step (column) does after each step (row) [K]."""
    free: Array
    """(n,): temperatures without heating [degC]."""
    low: Array
    high: Array
    """(n,): what is to be kept [degC]."""


def nothing_known(steps: int) -> Mapping[str, Mapping[str, Sequence[float]]]:
    """Weather and neighbours are left to Thermogate."""
    return {}


def rest(url: str, key: str | None = None, timeout: float = 20.0) -> Ask:
    """Thermogate at `url`, with an API key if it wants one."""

    def ask(method: str, path: str, body: Any = None) -> Any:
        headers = {"Content-Type": "application/json"} | ({"Authorization": f"Bearer {key}"} if key else {})
        content = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(url.rstrip("/") + path, content, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=timeout) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            with error:
                raise OSError(json.load(error)["detail"]) from error
        except http.client.HTTPException as error:
            raise OSError(f"the answer broke off: {error!r}") from error

    return ask


def reach(ask: Ask, zone: str, wanted: float) -> tuple[float, str, str]:
    """How far ahead (s, at most `wanted`) the forecasts are to be relied on, how, and why no further.

    Plan as far as the trust in forecasts under a plan reaches without a gap, up to the first horizon that is "learning"
    or "untrusted". What is doubtful within an hour takes twice the margin, but not for what acts on the zone that the
    model does not know: then the forecast's own interval is wide already. What goes wrong further ahead will be
    corrected by a later plan.
    """
    trusted, worst = 0.0, "trusted"
    answer = ask("GET", f"/zones/{zone}/trust", None)
    for horizon in answer["horizons"]:
        if horizon["planned"] not in ("trusted", "doubtful"):
            return trusted, worst, f"{horizon['planned']}: {horizon['reason']}"
        if trusted < SHORTEST and horizon["planned"] == "doubtful" and not answer["disturbed"]:
            worst = "doubtful"
        trusted = min(float(horizon["lead_s"]), wanted)
    return trusted, worst, ""


def forecasts(ask: Ask, settings: Settings, plans: Sequence[Array], known: Known = nothing_known) -> list[Forecast]:
    """What the zone does under each of `plans` (n,) [W]; what is not `known` of weather and neighbours is Thermogate's.
    The heating of other zones is held where it is not known, so name it where they are heated in turns."""
    steps = len(plans[0])
    told: dict[str, dict[str, Any]] = {
        zone: {channel: stepped(settings, values) for channel, values in inputs.items()}
        for zone, inputs in known(steps).items()
    }
    own = told.get(settings.zone, {})
    request = {
        "horizon": f"{steps * settings.step:.0f}s",
        "zones": [settings.zone],
        "plans": [
            {"inputs": told | {settings.zone: own | {settings.heater: stepped(settings, powers)}}} for powers in plans
        ],
    }
    found = []
    for answer in ask("POST", "/forecasts", request)["plans"]:
        (zone,) = answer["zones"]
        if zone["problem"] or zone["quality"] == "bad":
            raise ValueError(zone["problem"] or "the forecast has the quality bad")
        mean, sd = (np.array(zone["outputs"][0][name], dtype=float) for name in ("mean", "sd"))
        found.append(Forecast(mean, sd, round(settings.step / zone["period_s"]), zone["valid_time"]))
    return found


def around(ask: Ask, settings: Settings, powers: Array, known: Known = nothing_known) -> tuple[Forecast, Array]:
    """The forecast under the plan `powers` (n,) [W], and (m + 1,) what a W over the first step does at its times [K],
    both as Thermogate forecasts near a plan that will be: so the plan fits any estimator."""
    pulse = PULSE * settings.power * (-1.0 if powers[0] > 0.5 * settings.power else 1.0)
    now, pulsed = forecasts(ask, settings, [powers, np.concatenate([powers[:1] + pulse, powers[1:]])], known)
    return now, (pulsed.mean - now.mean) / pulse


def stepped(settings: Settings, values: Sequence[float] | Array) -> dict[str, Any]:
    """One value for each step, as a plan has it."""
    return {"step": f"{settings.step:.0f}s", "values": [float(value) for value in values]}


def plan(
    moved: Array,
    free: Array,
    low: Array,
    high: Array,
    prices: Array,
    most: Array,
    hours: float,
    shared: tuple[Array, Array] | None = None,
) -> Array:
    """The powers (m,) [W] of least cost: a linear programme, solved by HiGHS. Each of m is one room in one step.

    Args:
        moved: (m, m): what a W in a room and step (column) does to a room after a step (row) [K].
        free: (m,): what happens without heating [degC].
        low: (m,): with `high` what is to be kept [degC]. Leaving it costs DISCOMFORT, so there is always a plan.
        high: (m,).
        prices: (m,): per kWh of heat.
        most: (m,): powers of the heaters [W].
        hours: length of a step.
        shared: rows (s, m) whose products with the powers stay below limits (s,).
    """
    count = len(free)
    nothing, slack = np.zeros((count, count)), np.eye(count)
    cost = np.concatenate([prices * hours / 1000.0, np.full(2 * count, DISCOMFORT * hours)])
    # Too cold by at most the first slack, too warm by at most the second.
    sides = np.block([[-moved, -slack, nothing], [moved, nothing, -slack]])
    margins = np.concatenate([free - low, high - free])
    if shared is not None:
        rows, limits = shared
        sides = np.vstack([sides, np.hstack([rows, np.zeros((len(rows), 2 * count))])])
        margins = np.concatenate([margins, limits])
    bounds = [(0.0, power) for power in most] + [(0.0, None)] * (2 * count)
    solved = linprog(cost, A_ub=sides, b_ub=margins, bounds=bounds, method="highs")
    if not solved.success:
        raise ValueError(f"no plan was found: {solved.message}")
    # HiGHS keeps bounds but for its tolerance, and Thermogate refuses what is a hair beyond them.
    return np.clip(solved.x[:count], 0.0, most)


def thermostat(settings: Settings, temperature: float, heating: bool, low: float | None = None) -> float:
    """The power [W] of a thermostat at `temperature` [degC] that was `heating`, for a lower end of comfort `low`."""
    on_below = (settings.low if low is None else low) + (settings.differential if heating else 0.0)
    return settings.power if temperature < on_below else 0.0


def held(settings: Settings, decision: Decision, time: float, temperature: float) -> float:
    """The power [W] in the first step of a plan, after `temperature` [degC] was measured at `time`, UTC s: what was
    planned, and what brings the room back to the planned temperature within a step; nothing is added while the room is
    warm enough."""
    since = time - decision.start
    if since < 0.0 or decision.per_watt <= 0.0:
        return decision.power
    times = np.linspace(0.0, settings.step, len(decision.path))
    aside = float(np.interp(since, times, decision.path)) - temperature
    if aside > 0.0 and temperature >= decision.low:
        return decision.power
    return float(np.clip(decision.power + aside / decision.per_watt, 0.0, settings.power))


class Memory:
    """What was planned and heated in the last two days, by the time of the caller's clock in s."""

    def __init__(self, settings: Settings) -> None:
        self._step = settings.step
        self._plans: list[tuple[float, Array]] = []
        self._heated: list[tuple[float, float]] = []
        self._measured = -math.inf

    def planned(self, now: float, powers: Array) -> None:
        """A plan from `now` on [W]."""
        self._plans = [one for one in self._plans if one[0] > now - 2.0 * DAY] + [(now, powers)]

    def heated(self, now: float, power: float, measured: bool) -> None:
        """The power from `now` on [W], and whether anything is measured."""
        self._heated = [one for one in self._heated if one[0] > now - 2.0 * DAY] + [(now, power)]
        self._measured = now if measured else self._measured

    def left(self, now: float) -> Array:
        """What is left of the last plan [W]."""
        return self._plans[-1][1][int((now - self._plans[-1][0]) // self._step) :] if self._plans else np.empty(0)

    def blind(self, now: float) -> Decision:
        """Where nothing is measured: the last plan made BLIND s before that, for a stuck sensor is noticed late, then
        as a day before; ValueError without."""
        for made, powers in reversed(self._plans):
            place = int((now - made) // self._step)
            if made <= self._measured - BLIND and place < len(powers):
                return Decision(float(powers[place]), "last plan", "nothing is measured")
        day = [power for at, power in self._heated if 0.0 <= at - (now - DAY) < self._step]
        if not day:
            raise ValueError("nothing is measured, no plan is left, and nothing is known of the day before")
        return Decision(float(np.mean(day)), "day before", "nothing is measured, and no plan is left")


def decide(
    ask: Ask,
    settings: Settings,
    temperature: float,
    heating: bool,
    prices: Callable[[int], Sequence[float]] = lambda steps: [0.3] * steps,
    low: Callable[[int], Sequence[float]] | None = None,
    known: Known = nothing_known,
    before: Array | None = None,
) -> Decision:
    """The power now: by the plan if the forecasts can be trusted far enough, otherwise by a thermostat.

    `temperature` [degC] is measured, `heating` says whether it is heated now; `prices` and `low` are the price and the
    lower end of comfort of as many steps as asked for, from now on. `before` is what is left of the last plan [W], if
    there was one. The thermostat keeps the highest `low` of the next hour, so that a room is warm when a setback ends.

    The plan stays above the lower end of the band by what is uncertain of the next moment, for the next look can add
    heat; below its upper end by that of up to an hour, for heat cannot be taken back.
    """
    room = Room(settings, temperature, heating, low, before)
    return decide_together(ask, [room], prices, known)[0]


def decide_together(
    ask: Ask,
    rooms: Sequence[Room],
    prices: Callable[[int], Sequence[float]] = lambda steps: [0.3] * steps,
    known: Known = nothing_known,
    plant: Plant = DIRECT,
    reserved: float = 0.0,
) -> list[Decision]:
    """What `decide` says of each of `rooms`, which have one `plant` and steps of the same length. Prices are per kWh
    that the plant takes. Where it cannot heat all, `reserved` W of heat for rooms that are not decided here come first,
    then rooms that a thermostat heats, the coldest before the others; the plan of the others keeps to what is left for
    an hour, then to the limit."""
    found: dict[int, Decision] = {}
    views: dict[int, View] = {}

    def fall_back(place: int, error: Exception) -> None:
        room = rooms[place]
        soon = float(max(room.lowest(math.ceil(SHORTEST / room.settings.step))))
        power = thermostat(room.settings, room.temperature, room.heating, soon)
        found[place] = Decision(power, "thermostat", str(error))
        views.pop(place, None)

    for place, room in enumerate(rooms):
        try:
            views[place] = viewed(ask, room)
        except FAILURES as error:
            fall_back(place, error)
    powers = {place: _begun(rooms[place], view.steps) for place, view in views.items()}
    fresh = any(room.before is None or not len(room.before) for room in rooms)
    try:
        heat = heat_ahead(ask, rooms[0].settings, plant, max((view.steps for view in views.values()), default=1), known)
        for _ in range(ROUNDS if fresh else 1):
            asked, looks = dict(powers), {}
            for place in tuple(views):
                others = {rooms[other].settings.zone: (rooms[other].settings, asked[other]) for other in views}
                own = rooms[place].settings
                try:
                    looks[place] = around(ask, own, asked[place], beside(known, own.zone, others))
                except FAILURES as error:
                    fall_back(place, error)
            taken = (reserved + _allotted(rooms, found, plant.limit * heat[0] - reserved)) / heat[0]
            wishes = {place: _wish(rooms[place], view, *looks[place], asked[place]) for place, view in views.items()}
            if views:
                powers = _planned(rooms, views, wishes, prices, plant.limit, taken, heat)
    except FAILURES as error:
        for place in tuple(views):
            fall_back(place, error)
        # Nobody knows how much heat the plant gives: as much as in the worst case.
        _allotted(rooms, found, plant.limit * min(each for _, each in plant.cop) - reserved)
    for place, view in views.items():
        found[place] = _told(rooms[place], view, looks[place], wishes[place], asked[place], powers[place])
    return [found[place] for place in range(len(rooms))]


def viewed(ask: Ask, room: Room) -> View:
    """How far a room can be planned; ValueError where that is not an hour."""
    step = room.settings.step
    horizon, trust, why = reach(ask, room.settings.zone, room.settings.horizon)
    if horizon - horizon % step < SHORTEST:
        raise ValueError(f"the forecasts are not trusted for an hour ({why})")
    return View(int(horizon // step), trust, why)


def heat_ahead(ask: Ask, settings: Settings, plant: Plant, steps: int, known: Known) -> Array:
    """(n,): W of heat that `plant` gives for each W in the steps to come: by the outdoor temperature that is `known` of
    the zone, otherwise by that of the day before."""
    if len(plant.cop) == 1:
        return plant.heat_per_watt(np.zeros(steps))
    told = known(steps).get(settings.zone, {}).get(plant.outdoor)
    if told is not None:
        return plant.heat_per_watt(np.asarray(told, dtype=float)[:steps])
    series = ask("GET", f"/zones/{urllib.parse.quote(settings.zone)}/series?points=96", None)
    values = {one["channel"]: one["values"] for one in series["inputs"]}.get(plant.outdoor, ())
    there = [(seconds(at), value) for at, value in zip(series["times"], values, strict=False) if value is not None]
    if not there:
        raise ValueError(f"no outdoor temperature ({plant.outdoor}) is known, on which the heat pump depends")
    times, temperatures = zip(*there, strict=True)
    ahead = seconds(series["end"]) - DAY + np.mod(np.arange(steps) * settings.step, DAY)
    return plant.heat_per_watt(np.interp(ahead, times, temperatures))


def beside(known: Known, zone: str, others: Mapping[str, tuple[Settings, Array]]) -> Known:
    """What is `known`, and the planned heat of all `others` but `zone`; beyond its plan a room has its mean."""

    def told(steps: int) -> Mapping[str, Mapping[str, Sequence[float]]]:
        found = {name: dict(inputs) for name, inputs in known(steps).items()}
        for name, (settings, powers) in others.items():
            if name != zone:
                rest = np.concatenate([powers, np.full(steps, powers.mean())])[:steps]
                found.setdefault(name, {})[settings.heater] = rest.tolist()
        return found

    return told


def _begun(room: Room, steps: int) -> Array:
    """(n,): the powers around which the first plan is made [W]."""
    if room.before is None or not len(room.before):
        return np.full(steps, FIRST_GUESS * room.settings.power)
    return np.resize(room.before, steps)


def _allotted(rooms: Sequence[Room], found: dict[int, Decision], heat: float) -> float:
    """The heat [W] of the rooms with a thermostat; what is more than `heat` is taken from the warmest in `found`."""
    left = max(heat, 0.0)
    for place in sorted(found, key=lambda one: rooms[one].temperature - rooms[one].lowest(1)[0]):
        power = min(found[place].power, left)
        found[place], left = found[place]._replace(power=power), left - power
    return sum(decision.power for decision in found.values())


def _planned(
    rooms: Sequence[Room],
    views: Mapping[int, View],
    wishes: Mapping[int, Wish],
    prices: Callable[[int], Sequence[float]],
    limit: float,
    taken: float,
    heat: Array,
) -> dict[int, Array]:
    """The powers of the rooms in `views` by their `wishes`; of the `limit`, others have `taken` for an hour [W]."""
    steps = np.concatenate([np.arange(view.steps) for view in views.values()])
    price = np.concatenate([prices(view.steps) for view in views.values()]) / heat[steps]
    most = np.concatenate([np.full(view.steps, rooms[place].settings.power) for place, view in views.items()])
    step = rooms[0].settings.step
    shared = None
    if math.isfinite(limit):
        ahead = np.arange(len(heat))
        left = np.where(ahead * step < SHORTEST, max(limit - taken, 0.0), limit)
        shared = (steps == ahead[:, None]) / heat[:, None], left
    moved = block_diag(*(wish.moved for wish in wishes.values()))
    free, low, high = (np.concatenate(parts) for parts in zip(*(wish[1:] for wish in wishes.values()), strict=True))
    powers = plan(moved, free, low, high, price, most, step / HOUR, shared)
    ends = np.cumsum([view.steps for view in views.values()])
    return dict(zip(views, np.split(powers, ends[:-1]), strict=True))


def _wish(room: Room, view: View, now: Forecast, effect: Array, asked: Array) -> Wish:
    """By the forecast `now` under the powers `asked`, and the `effect` of a W over the first step."""
    settings, steps = room.settings, view.steps
    mean, sd = (values[:: now.every] for values in (now.mean, now.sd))
    moved = np.asarray(toeplitz(effect[:: now.every][1:], np.zeros(steps)), dtype=float)
    sure = settings.sure * (2.0 if view.trust == "doubtful" else 1.0)
    wanted = np.minimum(room.lowest(steps) + sure * sd[0], settings.high)
    until = np.minimum(np.arange(1, steps + 1), round(SHORTEST / settings.step))
    return Wish(moved, mean[1:] - moved @ asked, wanted, np.maximum(settings.high - sure * sd[until], wanted))


def _told(room: Room, view: View, look: tuple[Forecast, Array], wish: Wish, asked: Array, powers: Array) -> Decision:
    """The decision of a plan that was made around `asked`."""
    (now, effect), step = look, room.settings.step
    first = slice(0, now.every + 1)
    then = f"; then {view.why}" if view.why else ""
    reason = f"planned {view.steps * step / HOUR:.0f} h ahead from {now.valid_time}, {view.trust}{then}"
    path = now.mean[first] + (powers[0] - asked[0]) * effect[first]
    temperatures = wish.free + wish.moved @ powers
    start, low, per_watt = seconds(now.valid_time), float(wish.low[0]), float(wish.moved[0, 0])
    return Decision(float(powers[0]), "plan", reason, powers, temperatures, start, path, low, per_watt)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the powers every LOOK, and plan every step, for ever or `--times` often."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--url", default="http://127.0.0.1:8080", help="where the daemon serves")
    parser.add_argument("--key", help="API key, if the daemon wants one")
    parser.add_argument("--times", type=int, default=0, help="how many looks; 0: for ever")
    parser.add_argument("--zone", type=_heated, required=True, nargs="+", help="zones that are heated, NAME or NAME=W")
    parser.add_argument("--limit", type=_positive, default=math.inf, help="W that all rooms together may take")
    parser.add_argument("--cop", type=_performance, nargs="+", default=DIRECT.cop, help="heat per W: COP@degC outdoors")
    for one in fields(Settings)[1:]:
        told = f"{one.metadata['meaning']} (default {one.default})"
        kind = _positive if one.name in ("power", "step", "horizon") else type(one.default)
        parser.add_argument(f"--{one.name}", type=kind, default=one.default, help=told)
    given = vars(parser.parse_args(arguments))
    common = {one.name: given[one.name] for one in fields(Settings)[1:]}
    if not common["low"] < common["high"]:
        parser.error(f"--low {common['low']:g} is not below --high {common['high']:g}")
    if common["horizon"] < max(SHORTEST, common["step"]):
        parser.error(f"--horizon {common['horizon']:g} is shorter than a step, or than an hour")
    twice = {zone for place, (zone, _) in enumerate(given["zone"]) if zone in dict(given["zone"][:place])}
    if twice:
        parser.error(f"argument --zone: {', '.join(sorted(twice))} is there twice")
    named = ((zone, common if power is None else common | {"power": power}) for zone, power in given["zone"])
    rooms = [Controlled(Settings(zone, **own)) for zone, own in named]
    ask, plant = rest(given["url"], given["key"]), Plant(given["limit"], sorted(given["cop"]))
    for count in itertools.count(1):
        look(ask, rooms, plant, time.monotonic())
        if count == given["times"]:
            break
        time.sleep(min(LOOK, common["step"]))
    return 0


def _positive(word: str) -> float:
    number = float(word)
    if not number > 0.0:
        raise argparse.ArgumentTypeError(f"{word} is not above 0")
    return number


def _heated(word: str) -> tuple[str, float | None]:
    """The zone and the power [W] of `NAME=W`, or of `NAME`."""
    zone, _, power = word.partition("=")
    try:
        return zone, _positive(power) if power else None
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{word} is no zone with its power, such as living=2000") from error


def _performance(word: str) -> tuple[float, float]:
    """Outdoor temperature and COP of `COP@degC`."""
    try:
        cop, outdoor = map(float, word.split("@"))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{word} is no COP at an outdoor temperature, such as 3.4@2") from error
    if not cop > 0.0:
        raise argparse.ArgumentTypeError(f"{word}: the COP must be above 0")
    return outdoor, cop


class Controlled:
    """A room and what was decided for it."""

    def __init__(self, settings: Settings) -> None:
        self.settings, self.memory = settings, Memory(settings)
        self.decision: Decision | None = None
        self.made, self.power = -math.inf, 0.0
        """When the decision was made, by the caller's clock [s], and what is heated now [W]."""

    def holds(self, now: float) -> bool:
        """Whether its plan is still to be held."""
        planned = self.decision is not None and self.decision.by == "plan"
        return planned and now - self.made < self.settings.step - LOOK / 2.0


def look(ask: Ask, rooms: Sequence[Controlled], plant: Plant, now: float) -> None:
    """Measure all rooms, decide where that is due, and print what to do."""
    seen: dict[int, tuple[float, float]] = {}
    decided, left = [], 0.0
    for place, room in enumerate(rooms):
        try:
            at, temperature = measured(ask, room.settings.zone)
            if temperature is not None:
                seen[place] = at, temperature
            else:
                room.decision, room.made = room.memory.blind(now), -math.inf
                room.power = room.decision.power
            decided.append(room)
        except FAILURES as error:
            sentence = f"no decision ({error}); the plant's own thermostat has to heat"
            # With as much as it likes.
            left += room.settings.power
            print(f"{room.settings.zone}: {sentence}", file=sys.stderr)
    if all(rooms[place].holds(now) for place in seen):
        for place, (at, temperature) in seen.items():
            room = rooms[place]
            assert room.decision is not None
            room.power = held(room.settings, room.decision, at, temperature)
    else:
        # What one room takes is missing in another, so that all are planned anew.
        asked = [
            Room(rooms[place].settings, temperature, rooms[place].power > 0.0, before=rooms[place].memory.left(now))
            for place, (_, temperature) in seen.items()
        ]
        reserved = left + sum(room.power for room in decided if rooms.index(room) not in seen)
        for place, decision in zip(seen, decide_together(ask, asked, plant=plant, reserved=reserved), strict=True):
            room = rooms[place]
            room.decision, room.made, room.power = decision, now, decision.power
            if decision.by == "plan":
                room.memory.planned(now, decision.plan)
    share = _share(ask, [room.settings for room in decided], sum(room.power for room in decided), plant, left)
    for room in decided:
        place = rooms.index(room)
        assert room.decision is not None
        room.power *= share
        room.memory.heated(now, room.power, place in seen)
        known = f"{seen[place][1]:.1f} degC" if place in seen else "an unknown temperature"
        told = f"{room.power:.0f} W by {room.decision.by} at {known}: {room.decision.reason}"
        print(f"{room.settings.zone}: {told}", flush=True)


def _share(ask: Ask, rooms: Sequence[Settings], heat: float, plant: Plant, reserved: float) -> float:
    """Of the `heat` [W] of all `rooms` together, what the plant can give now beside the `reserved` W: the rooms
    hold plans that did not know each other's corrections."""
    if not rooms or not math.isfinite(plant.limit) or heat <= 0.0:
        return 1.0
    try:
        most = plant.limit * float(heat_ahead(ask, rooms[0], plant, 1, nothing_known)[0])
    except FAILURES:
        most = plant.limit * min(each for _, each in plant.cop)
    return min(1.0, max(most - reserved, 0.0) / heat)


def measured(ask: Ask, zone: str) -> tuple[float, float | None]:
    """When the last sample was taken, UTC s, and its temperature [degC]: None where it is missing or was refused, or
    where the zone is stalled or failed, and nobody knows how warm it has become since. ValueError before the first."""
    path = f"/zones/{urllib.parse.quote(zone)}"
    rows = ask("GET", f"{path}/history?limit=1", None)["rows"]
    if not rows:
        raise ValueError("the zone has no sample yet")
    row = rows[-1]
    silent = ask("GET", path, None)["status"]["state"] in ("stalled", "failed")
    return seconds(row["time"]), None if silent or row["y"] is None else float(row["y"])


def seconds(time: str) -> float:
    """UTC s of an RFC 3339 time."""
    return datetime.fromisoformat(time).timestamp()


if __name__ == "__main__":
    sys.exit(main())
