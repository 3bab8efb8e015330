"""A controller that heats a zone as cheaply as comfort allows, over Thermogate's REST API.

    python mpc.py --url http://127.0.0.1:8080 --zone living --heater u_heat --power 2000 --low 20 --high 23

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
DISCOMFORT = 100.0
"""What a kelvin outside the comfort band costs for an hour, in the currency of the price."""


def _told(meaning: str, default: Any) -> Any:
    """A setting with what it is, for --help."""
    return field(default=default, metadata={"meaning": meaning})


@dataclass(frozen=True)
class Settings:
    """What is controlled and how. Powers in W, temperatures in degC, times in s, prices per kWh.

    `sure` is 1.64 for a 90 % interval, and counts twice where forecasts are doubtful.
    """

    zone: str
    heater: str = _told("the input that is planned", "u_heat")
    power: float = _told("the heater's largest power, W", 2000.0)
    low: float = _told("lower end of the comfort band, degC", 20.0)
    high: float = _told("its upper end, degC", 23.0)
    step: float = _told("from one plan to the next, s", 900.0)
    horizon: float = _told("how far a plan reaches at most, s", 86400.0)
    differential: float = _told("between the thermostat's switching on and off, K", 0.3)
    sure: float = _told("standard deviations of the forecast that a plan stays inside the comfort band", 1.64)


class Decision(NamedTuple):
    """The power [W] until the next decision, who decided, why, and the planned powers and temperatures.

    For `held`: the first step begins at `start`, UTC s; `path` [degC] is planned at its beginning and after each period
    of the zone; the plan keeps `low` [degC] in it, and a watt over the step moves the room by `per_watt` K.
    """

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

    The rule: plan as far as the trust in forecasts under a plan reaches without a gap, up to the first horizon that is
    "learning" or "untrusted".
    What is doubtful within an hour is "doubtful", and takes twice the margin. Doubt further ahead does not: what goes
    wrong there will be seen, and corrected by a later plan. Nor does doubt because something acts on the zone that the
    model does not know: then the forecast's own interval is wide already.
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

    The heating of other zones is held where it is not known, so name it where they are heated in turns.
    """
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
    """The forecast under the plan `powers` (n,) [W], and (m + 1,) what a W over the first step does at its times [K].

    Both are what Thermogate forecasts, so the plan fits any estimator; near a plan that will be, a bank of several
    models is asked nothing that it has never seen.
    """
    pulse = PULSE * settings.power * (-1.0 if powers[0] > 0.5 * settings.power else 1.0)
    now, pulsed = forecasts(ask, settings, [powers, np.concatenate([powers[:1] + pulse, powers[1:]])], known)
    return now, (pulsed.mean - now.mean) / pulse


def stepped(settings: Settings, values: Sequence[float] | Array) -> dict[str, Any]:
    """One value for each step, as a plan has it."""
    return {"step": f"{settings.step:.0f}s", "values": [float(value) for value in values]}


def plan(settings: Settings, free: Array, response: Array, prices: Sequence[float], low: Array, high: Array) -> Array:
    """The powers (n,) [W] of least cost: a linear programme, solved by HiGHS.

    `free` (n + 1,) [degC] is what happens without heating, `response` (n,) what a W does, `prices` (n,) per kWh; `low`
    and `high` (n,) [degC] are to be kept after each step. Leaving them costs DISCOMFORT, so there is always a plan.
    """
    steps, hours = len(response), settings.step / HOUR
    moved = np.array([[response[k - j] if j <= k else 0.0 for j in range(steps)] for k in range(steps)])
    nothing, slack = np.zeros((steps, steps)), np.eye(steps)
    cost = np.concatenate([np.asarray(prices) * hours / 1000.0, np.full(2 * steps, DISCOMFORT * hours)])
    # Too cold by at most the first slack, too warm by at most the second.
    sides = np.block([[-moved, -slack, nothing], [moved, nothing, -slack]])
    margins = np.concatenate([free[1:] - low, high - free[1:]])
    bounds = [(0.0, settings.power)] * steps + [(0.0, None)] * (2 * steps)
    solved = linprog(cost, A_ub=sides, b_ub=margins, bounds=bounds, method="highs")
    if not solved.success:
        raise ValueError(f"no plan was found: {solved.message}")
    return np.asarray(solved.x[:steps], dtype=float)


def thermostat(settings: Settings, temperature: float, heating: bool, low: float | None = None) -> float:
    """The power [W] of a thermostat at `temperature` [degC] that was `heating`, for a lower end of comfort `low`."""
    on_below = (settings.low if low is None else low) + (settings.differential if heating else 0.0)
    return settings.power if temperature < on_below else 0.0


def held(settings: Settings, decision: Decision, time: float, temperature: float) -> float:
    """The power [W] in the first step of a plan, after `temperature` [degC] was measured at `time`, UTC s.

    It is what was planned, and what brings the room back to the planned temperature within a step; nothing is added
    while the room is warm enough.
    """
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
        """Where nothing is measured: the last plan made BLIND s before that, then as a day before; ValueError without.

        A sensor that is stuck is noticed late, and what was planned meanwhile has believed it.
        """
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
    there was one. The thermostat keeps the highest `low` of the next hour, so that a room is warm when a night setback
    ends.

    The plan stays inside the band by what is uncertain of the forecast: above its lower end by that of the next moment,
    for the next look can add heat; below its upper end by that of up to an hour, for heat cannot be taken back. What
    goes wrong later will be seen, and corrected by a later plan.
    """
    try:
        horizon, trust, why = reach(ask, settings.zone, settings.horizon)
        horizon -= horizon % settings.step
        if horizon < SHORTEST:
            raise ValueError(f"the forecasts are not trusted for an hour ({why})")
        steps = round(horizon / settings.step)
        lowest = np.array(low(steps) if low is not None else [settings.low] * steps)
        known_plan = before is not None and len(before) > 0
        powers = np.resize(before, steps) if known_plan else np.full(steps, FIRST_GUESS * settings.power)
        for _ in range(1 if known_plan else ROUNDS):
            now, effect = around(ask, settings, powers, known)
            mean, sd, response = (values[:: now.every] for values in (now.mean, now.sd, effect))
            free = mean - np.concatenate([[0.0], np.convolve(powers, response[1:])[:steps]])
            sure = settings.sure * (2.0 if trust == "doubtful" else 1.0)
            wanted = np.minimum(lowest + sure * sd[0], settings.high)
            until = np.minimum(np.arange(1, steps + 1), round(SHORTEST / settings.step))
            kept = np.maximum(settings.high - sure * sd[until], wanted)
            tried, powers = powers, plan(settings, free, response[1:], prices(steps), wanted, kept)
        temperatures = free[1:] + np.convolve(powers, response[1:])[:steps]
        first = slice(0, now.every + 1)
        path = now.mean[first] + (powers[0] - tried[0]) * effect[first]
        then = f"; then {why}" if why else ""
        reason = f"planned {horizon / HOUR:.0f} h ahead from {now.valid_time}, {trust}{then}"
        power, per_watt, start = float(powers[0]), float(response[1]), seconds(now.valid_time)
        return Decision(power, "plan", reason, powers, temperatures, start, path, float(wanted[0]), per_watt)
    except (OSError, ValueError, KeyError) as error:
        soon = settings.low if low is None else max(low(math.ceil(SHORTEST / settings.step)))
        return Decision(thermostat(settings, temperature, heating, soon), "thermostat", str(error))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a power every LOOK, and plan every step, for ever or `--times` often."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--url", default="http://127.0.0.1:8080", help="where the daemon serves")
    parser.add_argument("--key", help="API key, if the daemon wants one")
    parser.add_argument("--times", type=int, default=0, help="how many looks; 0: for ever")
    parser.add_argument("--zone", required=True, help="the zone that is heated")
    for one in fields(Settings)[1:]:
        told = f"{one.metadata['meaning']} (default {one.default})"
        parser.add_argument(f"--{one.name}", type=type(one.default), default=one.default, help=told)
    given = vars(parser.parse_args(arguments))
    settings = Settings(**{one.name: given[one.name] for one in fields(Settings)})
    ask = rest(given["url"], given["key"])
    memory, decision, made, power = Memory(settings), None, -math.inf, 0.0
    for count in itertools.count(1):
        now = time.monotonic()
        try:
            at, temperature = measured(ask, settings.zone)
            if temperature is None:
                decision = memory.blind(now)
                power = decision.power
            elif decision is not None and decision.by == "plan" and now - made < settings.step - LOOK / 2.0:
                power = held(settings, decision, at, temperature)
            else:
                decision, made = decide(ask, settings, temperature, power > 0.0, before=memory.left(now)), now
                power = decision.power
                if decision.by == "plan":
                    memory.planned(now, decision.plan)
        except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
            print(f"no decision ({error}); the plant's own thermostat has to heat", file=sys.stderr)
        else:
            memory.heated(now, power, temperature is not None)
            seen = "an unknown temperature" if temperature is None else f"{temperature:.1f} degC"
            print(f"{power:.0f} W by {decision.by} at {seen}: {decision.reason}", flush=True)
        if count == given["times"]:
            break
        time.sleep(min(LOOK, settings.step))
    return 0


def measured(ask: Ask, zone: str) -> tuple[float, float | None]:
    """When the last sample was taken, UTC s, and its temperature [degC]: None where it is missing or was refused, or
    where the zone is stalled or failed, and nobody knows how warm it has become since."""
    path = f"/zones/{urllib.parse.quote(zone)}"
    row = ask("GET", f"{path}/history?limit=1", None)["rows"][-1]
    silent = ask("GET", path, None)["status"]["state"] in ("stalled", "failed")
    return seconds(row["time"]), None if silent or row["y"] is None else float(row["y"])


def seconds(time: str) -> float:
    """UTC s of an RFC 3339 time."""
    return datetime.fromisoformat(time).timestamp()


if __name__ == "__main__":
    sys.exit(main())
