"""A room as EMHASS's thermal model, learned by Thermogate: the parameters of one optimisation.

    python emhass.py --zone living --heater u_heat --power 2000 --low 20 --high 23 > room.json
    curl -H 'Content-Type: application/json' -d @room.json http://127.0.0.1:5000/action/naive-mpc-optim

EMHASS knows one thermal mass, `T' = heating_rate * power / nominal - cooling_constant * (T - T_out)`, per hour. Its two
numbers are fitted here to what heating by turns changes in Thermogate's forecast. What the one mass lacks (walls, sun,
people, the weather to come) goes into the outdoor temperature: without heating, EMHASS foresees what Thermogate does.
That temperature is this room's alone: one optimisation for each room. It needs NumPy. Exit codes: 0; 1 with the reason.
"""

from __future__ import annotations

import argparse
import json
import sys
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Ask = Callable[[str, str, Any], Any]
"""Method, path and body (None for none) to the JSON that answers; OSError or ValueError if there is no answer."""

COOLING = np.geomspace(1e-3, 1.0, 600)
"""Cooling constants that are tried [1/h]: time constants of 1 to 1,000 h."""
TURN = 4.0
"""h for which heat is tried on, and then off."""


def asking(url: str, key: str | None = None) -> Ask:
    """REST at `url`, with an API key if it wants one."""

    def ask(method: str, path: str, body: Any) -> Any:
        data = None if body is None else json.dumps(body).encode()
        headers = {"Content-Type": "application/json"} | ({"Authorization": f"Bearer {key}"} if key else {})
        request = urllib.request.Request(url.rstrip("/") + path, data, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            raise OSError(json.load(error).get("detail", str(error))) from error

    return ask


def one_mass(rise: Array, shares: Array, step: float) -> tuple[float, float]:
    """Heating rate [K/h] and cooling constant [1/h] of the mass that heating with `shares` (n,) of the largest power
    warms by `rise` (n + 1,) [K] in steps of `step` h, as EMHASS steps it."""
    kept = 1.0 - COOLING[COOLING * step < 1.0] * step
    per_rate = np.zeros((len(kept), len(rise)))
    for k, share in enumerate(shares):
        per_rate[:, k + 1] = kept * per_rate[:, k] + step * share
    rates = per_rate @ rise / (per_rate**2).sum(axis=1)
    best = int(np.argmin(((rates[:, None] * per_rate - rise) ** 2).sum(axis=1)))
    return float(rates[best]), float((1.0 - kept[best]) / step)


def handed_on(
    ask: Ask, zone: str, heater: str, power: float, low: float, high: float, step: int = 30
) -> dict[str, Any]:
    """What EMHASS is told of `zone` for a day in steps of `step` min; ValueError where its forecasts are no use, or
    `low` lies above `high`."""
    if low > high:
        raise ValueError(f"the lowest temperature, {low:g} degC, lies above the highest, {high:g} degC; swap them")
    trust = ask("GET", f"/zones/{zone}/trust", None)["horizons"][-1]
    if trust["planned"] in ("learning", "untrusted"):
        raise ValueError(f"forecasts of zone '{zone}' a day ahead are {trust['planned']}: {trust['reason']}")

    def path(watts: Any) -> Array:
        answer = ask("POST", f"/zones/{zone}/forecast", {"horizon": "24h", "inputs": {heater: watts}})
        stride = step * 60 / answer["period_s"]
        if stride != int(stride) or stride < 1:
            raise ValueError(
                f"a step of {step} min is not one or more of the zone's periods of {answer['period_s']:g} s"
            )
        return np.array([each["outputs"][0]["mean"] for each in answer["fan"]][:: int(stride)])

    hours, off = step / 60.0, path(0.0)
    count = len(off) - 1
    # As plans do: heat for some hours, and then none.
    turns = np.arange(count) * hours % (2 * TURN) < TURN
    on = path({"step": f"{step}min", "values": (power * turns).tolist()})
    rate, cooling = one_mass(on - off, turns, hours)
    if rate <= 0.0:
        raise ValueError(f"heating with {heater} does not warm zone '{zone}' in its forecast")
    warmed = rate * hours * (1.0 - (1.0 - cooling * hours) ** np.arange(count)) / (cooling * hours)
    outdoor = off[:-1] + np.diff(off) / (cooling * hours)
    return {
        "prediction_horizon": count,
        "optimization_time_step": step,
        "number_of_deferrable_loads": 1,
        "nominal_power_of_deferrable_loads": [power],
        "treat_deferrable_load_as_semi_cont": [False],
        "def_load_config": [
            {
                "thermal_config": {
                    "heating_rate": rate,
                    "cooling_constant": cooling,
                    "start_temperature": float(off[0]),
                    # EMHASS keeps its bounds at any price and has no plan where they cannot be kept.
                    "min_temperatures": np.minimum(low, off[:-1] + warmed - 1e-6).tolist(),
                    "max_temperatures": np.maximum(high, off[:-1] + 1e-6).tolist(),
                    "sense": "heat",
                }
            }
        ],
        "outdoor_temperature_forecast": outdoor.tolist(),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--url", default="http://127.0.0.1:8080", help="Thermogate")
    parser.add_argument("--key", help="API key, if the daemon wants one")
    parser.add_argument("--zone", required=True)
    parser.add_argument("--heater", default="u_heat", help="the input that heats")
    parser.add_argument("--power", type=float, required=True, help="its largest power, W")
    parser.add_argument("--low", type=float, default=20.0, help="degC")
    parser.add_argument("--high", type=float, default=23.0, help="degC")
    parser.add_argument("--step", type=int, default=30, help="EMHASS's optimization_time_step, min")
    given = vars(parser.parse_args())
    try:
        print(json.dumps(handed_on(asking(given.pop("url"), given.pop("key")), **given)))
    except (OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
