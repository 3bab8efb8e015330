"""The example that hands a room on to EMHASS: its one mass, and what EMHASS itself plans with it."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.tables import tabled

EMHASS = Path(os.environ.get("THERMOGATE_EMHASS", Path(sys.prefix) / "emhass" / "bin" / "python"))
"""The interpreter of an environment with the package `emhass`, which shares too little with ours to be in it."""

EXAMPLE = "emhass"
POWER, LOW, HIGH = 4000.0, 20.0, 23.0

PLANNED = """
import asyncio, json, logging, pathlib, sys
import numpy as np, pandas as pd
import emhass
from emhass import utils
from emhass.optimization import Optimization

async def main():
    told, log, root = json.load(sys.stdin), logging.getLogger("emhass"), pathlib.Path(emhass.__file__).parent
    data = root / "data"
    paths = {"root_path": root, "data_path": pathlib.Path(sys.argv[1]), "defaults_path": data / "config_defaults.json"}
    paths["associations_path"] = data / "associations.csv"
    config = await utils.build_config(paths, log, str(paths["defaults_path"]))
    config |= {name: value for name, value in told.items() if name in config}
    paths, secrets = await utils.build_secrets(paths, log, no_response=True)
    retrieve, optim, plant = utils.get_yaml_parse(await utils.build_params(paths, secrets, config, log), log)
    optim["def_load_config"], count = told["def_load_config"], told["prediction_horizon"]
    index = pd.date_range("2026-01-01", periods=count, freq=retrieve["optimization_time_step"], tz="UTC")
    frame = pd.DataFrame({"outdoor_temperature_forecast": told["outdoor_temperature_forecast"]}, index=index)
    none, price = np.zeros(count), np.array(told["load_cost_forecast"])
    planner = Optimization(retrieve, optim, plant, "unit_load_cost", "unit_prod_price", "cost", paths, log)
    found = planner.perform_optimization(frame, none, none, price, none, def_total_hours=[0])
    told = {"status": str(found["optim_status"].iloc[0]), "power": found["P_deferrable0"].tolist()}
    print(json.dumps(told | {"temperature": found["predicted_temp_heater0"].tolist()}))

asyncio.run(main())
"""


def stepped(told: dict[str, Any], power: Any) -> Any:
    """The temperatures that EMHASS's equation makes of `power` [W]."""
    (load,), hours = told["def_load_config"], told["optimization_time_step"] / 60.0
    config, found = load["thermal_config"], [load["thermal_config"]["start_temperature"]]
    for outdoor, watts in zip(told["outdoor_temperature_forecast"], power, strict=True):
        lost = config["cooling_constant"] * (found[-1] - outdoor)
        found.append(found[-1] + hours * (config["heating_rate"] * watts / POWER - lost))
    return np.array(found)


def means(asking: Any, power: Any) -> Any:
    """Thermogate's forecast under `power` [W], as often."""
    answer = asking()("POST", "/zones/office/forecast", {"horizon": "24h", "inputs": {"u_heat": power}})
    return np.array([each["outputs"][0]["mean"] for each in answer["fan"]])[::6]


@pytest.mark.parametrize(("rate", "cooling"), [(2.0, 0.05), (0.4, 0.01), (6.0, 0.3)])
def test_one_mass_is_found_as_it_is(example: ModuleType, rate: float, cooling: float) -> None:
    rise, shares = [0.0], np.arange(48) % 16 < 8
    for share in shares:
        rise.append(rise[-1] + 0.5 * (rate * share - cooling * rise[-1]))
    assert example.one_mass(np.array(rise), shares, 0.5) == pytest.approx((rate, cooling), rel=0.02)


def test_without_heating_it_foresees_what_thermogate_does_and_with_it_nearly(example: ModuleType, asking: Any) -> None:
    told = example.handed_on(asking({86400: "trusted"}), "office", "u_heat", POWER, LOW, HIGH)
    count = told["prediction_horizon"]
    assert (count, len(told["outdoor_temperature_forecast"])) == (48, 48)
    assert stepped(told, np.zeros(count)) == pytest.approx(means(asking, 0.0), abs=1e-9)
    heated, itself = stepped(told, np.full(count, POWER)), means(asking, POWER)
    rise = itself[-1] - means(asking, 0.0)[-1]
    assert rise > 10.0
    # A room and its walls are two masses: one mass warms a little too slowly at first.
    assert np.abs(heated - itself).max() < 0.15 * rise


@tabled
def test_what_cannot_be_handed_on_is_one_sentence(
    example: ModuleType, asking: Any, trust: str, low: float, step: int, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        example.handed_on(asking({86400: trust}), "office", "u_heat", POWER, low, HIGH, step)


@pytest.mark.skipif(not EMHASS.exists(), reason="EMHASS is not installed; THERMOGATE_EMHASS names its interpreter")
def test_emhass_plans_with_it(example: ModuleType, asking: Any, tmp_path: Path) -> None:
    told = example.handed_on(asking({86400: "trusted"}), "office", "u_heat", POWER, LOW, HIGH)
    given = json.dumps(told | {"load_cost_forecast": [0.3] * 12 + [0.1] * 12 + [0.3] * 24})
    done = subprocess.run(
        [EMHASS, "-c", PLANNED, tmp_path], input=given, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    plan = json.loads(done.stdout.splitlines()[-1])
    assert plan["status"] == "Optimal"
    power, temperature = np.array(plan["power"]), np.array(plan["temperature"])
    # It tells temperatures in hundredths.
    assert temperature == pytest.approx(stepped(told, power)[:-1], abs=0.0051)
    assert temperature.min() >= LOW - 0.01
    assert temperature.max() <= HIGH + 0.01
    # It heats while that is cheap, and Thermogate agrees with what comes of it.
    assert power[12:24].mean() > 1.3 * power[:12].mean()
    values = {"step": "30min", "values": power.clip(0.0, POWER).tolist()}
    # Here the one mass stands for two.
    assert np.sqrt(np.mean((means(asking, values)[:-1] - temperature) ** 2)) < 0.6
