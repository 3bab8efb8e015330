"""A controller that heats a zone as cheaply as comfort allows, over Thermogate's REST API.

    python mpc.py --url http://127.0.0.1:8080 --zone living --heater u_heat --power 2000 --low 20 --high 23

It asks for the trust in the zone's forecasts, for the forecast without heating and for the zone's model, plans the
heating by a linear programme, and prints what to do now. Where the forecasts cannot be trusted, or no answer comes, it
is a thermostat. It needs NumPy and SciPy. Writing the power to the plant is yours: Thermogate never writes.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
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
"""s after which a thermostat looks again: a room is soon too warm."""
DISCOMFORT = 100.0
"""What a kelvin outside the comfort band costs for an hour, in the currency of the price."""


@dataclass(frozen=True)
class Settings:
    """What is controlled and how. Powers in W, temperatures in degC, times in s, prices per kWh."""

    zone: str
    heater: str = "u_heat"
    power: float = 2000.0
    low: float = 20.0
    high: float = 23.0
    step: float = 900.0
    horizon: float = 86400.0
    differential: float = 0.3
    """Between the thermostat's switching on and off, K."""
    margin: float = 0.3
    """What a plan keeps above the lower end of comfort, K, twice that where forecasts are doubtful."""


class Decision(NamedTuple):
    """The power [W] until the next decision, who decided, why, and the planned powers [W] and temperatures [degC]."""

    power: float
    by: str
    reason: str
    plan: Array
    temperatures: Array


class Forecast(NamedTuple):
    """Of a zone under a plan: the mean (n + 1,) [degC] at the beginning and after each step, and the valid time."""

    mean: Array
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

    return ask


def reach(ask: Ask, zone: str, wanted: float) -> tuple[float, str, str]:
    """How far ahead (s, at most `wanted`) the forecasts are to be relied on, how, and why no further.

    The rule: plan as far as the trust reaches without a gap, up to the first horizon that is "learning" or "untrusted".
    What is doubtful within an hour is "doubtful", and takes twice the margin. Doubt further ahead does not: what goes
    wrong there will be seen, and corrected by a later plan.
    """
    trusted, worst = 0.0, "trusted"
    for horizon in ask("GET", f"/zones/{zone}/trust", None)["horizons"]:
        if horizon["trust"] not in ("trusted", "doubtful"):
            return trusted, worst, f"{horizon['trust']}: {horizon['reason']}"
        if trusted < SHORTEST and horizon["trust"] == "doubtful":
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
        output, every = zone["outputs"][0], round(settings.step / zone["period_s"])
        mean = np.array(output["mean"], dtype=float)[::every]
        found.append(Forecast(mean, zone["valid_time"]))
    return found


def around(ask: Ask, settings: Settings, powers: Array, known: Known = nothing_known) -> tuple[Forecast, Array]:
    """The forecast under the plan `powers` (n,) [W], and (n,) what a W over the first step does to the end of each [K].

    Both are what Thermogate forecasts, so the plan fits any estimator; near a plan that will be, a bank of several
    models is asked nothing that it has never seen.
    """
    pulse = PULSE * settings.power * (-1.0 if powers[0] > 0.5 * settings.power else 1.0)
    now, pulsed = forecasts(ask, settings, [powers, np.concatenate([powers[:1] + pulse, powers[1:]])], known)
    return now, (pulsed.mean - now.mean)[1:] / pulse


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


def decide(
    ask: Ask,
    settings: Settings,
    temperature: float | None,
    heating: bool,
    prices: Callable[[int], Sequence[float]] = lambda steps: [0.3] * steps,
    low: Callable[[int], Sequence[float]] | None = None,
    known: Known = nothing_known,
    before: Array | None = None,
) -> Decision:
    """The power now: by the plan if the forecasts can be trusted far enough, otherwise by a thermostat.

    `temperature` [degC] is measured (None: nothing is), `heating` says whether it is heated now; `prices` and `low` are
    the price and the lower end of comfort of as many steps as asked for, from now on. `before` is what is left of the
    last plan [W], if there was one. The thermostat keeps the highest `low` of the next hour, so that a room is warm
    when a night setback ends. Where nothing is measured, the last plan goes on as long as it reaches; ValueError when
    it has come to its end: then the plant's own thermostat has to heat.
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
            now, response = around(ask, settings, powers, known)
            free = now.mean - np.concatenate([[0.0], np.convolve(powers, response)[:steps]])
            margin = settings.margin * (2.0 if trust == "doubtful" else 1.0)
            wanted = np.minimum(lowest + margin, settings.high)
            powers = plan(settings, free, response, prices(steps), wanted, np.full(steps, settings.high))
        temperatures = free[1:] + np.convolve(powers, response)[:steps]
        then = f"; then {why}" if why else ""
        reason = f"planned {horizon / HOUR:.0f} h ahead from {now.valid_time}, {trust}{then}"
        return Decision(float(powers[0]), "plan", reason, powers, temperatures)
    except (OSError, ValueError, KeyError) as error:
        nothing: Array = np.empty(0)
        if temperature is None:
            if before is None or not len(before):
                raise ValueError(f"nothing is measured and no plan is left ({error})") from error
            return Decision(float(before[0]), "last plan", f"nothing is measured ({error})", before, nothing)
        soon = settings.low if low is None else max(low(math.ceil(SHORTEST / settings.step)))
        return Decision(thermostat(settings, temperature, heating, soon), "thermostat", str(error), nothing, nothing)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a decision every step, more often while a thermostat heats, for ever or `--times` often."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--url", default="http://127.0.0.1:8080")
    parser.add_argument("--key", help="API key, if the daemon wants one")
    parser.add_argument("--times", type=int, default=0, help="how many decisions; 0: for ever")
    defaults: Mapping[str, Any] = Settings("").__dict__
    for name, default in defaults.items():
        parser.add_argument(f"--{name}", type=type(default), required=name == "zone", default=default)
    given = vars(parser.parse_args(arguments))
    settings, ask = Settings(**{name: given[name] for name in defaults}), rest(given["url"], given["key"])
    heating, count = False, 0
    planned, powers = time.monotonic(), np.empty(0)
    while True:
        pause, before = LOOK, powers[round((time.monotonic() - planned) / settings.step) :]
        try:
            history = ask("GET", f"/zones/{urllib.parse.quote(settings.zone)}/history?limit=1", None)
            measured = history["rows"][-1]["y"]
            temperature = None if measured is None else float(measured)
            decision = decide(ask, settings, temperature, heating, before=before)
        except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
            print(f"no decision ({error}); the plant's own thermostat has to heat", file=sys.stderr)
        else:
            heating = decision.power > 0.0
            if decision.by == "plan":
                planned, powers = time.monotonic(), decision.plan
            pause = LOOK if decision.by == "thermostat" else settings.step
            seen = "an unknown temperature" if temperature is None else f"{temperature:.1f} degC"
            print(f"{decision.power:.0f} W by {decision.by} at {seen}: {decision.reason}", flush=True)
        count += 1
        if count == given["times"]:
            return 0
        time.sleep(min(pause, settings.step))


if __name__ == "__main__":
    sys.exit(main())
