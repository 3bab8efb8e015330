"""Short synthetic recordings for the example configurations, so that each can be checked and tried from a fresh clone.

`python -m replay.simulated.standins DIR` writes them; the same code always writes the same bytes.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from scipy.signal import max_len_seq

from estimator.arrays import Array
from estimator.network.network import Parameter
from estimator.network.presets import titeth, titethria
from replay.localtime import DAY, HOUR, midnight, wall_clock
from replay.recorded.raw_telemetry import Faults
from replay.recorded.tables import cells, local_stamps, write_table
from replay.simulated import ecolar, semi_synthetic
from replay.simulated.events import Habit, habitual
from replay.simulated.heating import Loads, Panel, simulate_heated
from replay.simulated.simulate import dynamics, simulate
from replay.simulated.weather import KONSTANZ, weather

BUILDING_67_FILE = "building-67-standin.csv.gz"
ECOLAR_FILE = "ecolar-standin.csv.gz"
FLEXHOUSE_FILE = "flexhouse-standin.csv.gz"
GENERIC_FILE = "generic.csv"

FLEXHOUSE = titethria().with_solar("T_i", Parameter("A_w", "m2", 0.1, 30.0))
FLEXHOUSE_THETA = {
    "C_i": 1.1e6,
    "C_e": 1.2e7,
    "C_h": 5e5,
    "g_ie": 1100.0,
    "g_e_out": 210.0,
    "g_ih": 900.0,
    "g_i_out": 25.0,
    "A_w": 4.0,
}
FLEXHOUSE_PERIOD = 300
FLEXHOUSE_BIT = 4  # steps of 5 min that one bit of the binary sequence lasts

GENERIC_THETA = {"C_i": 1.8e6, "C_e": 1.9e7, "C_h": 1.5e5, "g_ie": 420.0, "g_e_out": 70.0, "g_ih": 110.0}
GENERIC_PANEL = Panel(2000.0, 0.0, 0.4, 5)
GENERIC_PEOPLE = (Habit((0, 1, 2, 3, 4, 5, 6), (7.0, 22.0), 4.0, (30 * 60, 3 * HOUR), (80.0, 600.0)),)


def write_standins(directory: Path) -> list[Path]:
    """Write every stand-in into `directory` (made if need be); returns their paths."""
    directory.mkdir(parents=True, exist_ok=True)
    return [
        write_flexhouse(directory / FLEXHOUSE_FILE),
        semi_synthetic.write_csv(semi_synthetic.generate(None, days=3, seed=67), directory / BUILDING_67_FILE),
        write_ecolar(directory / ECOLAR_FILE),
        write_generic(directory / GENERIC_FILE),
    ]


def write_flexhouse(path: Path) -> Path:
    """Two winter days of a light office heated by a pseudo-random binary sequence, in the FlexHouse columns."""
    rng = np.random.default_rng([5, 1])
    start = int(datetime(2021, 2, 8, 14, 26, tzinfo=UTC).timestamp())
    times = start + FLEXHOUSE_PERIOD * np.arange(2 * DAY // FLEXHOUSE_PERIOD)
    sky = weather(times, KONSTANZ, 5)
    bits, _ = max_len_seq(8, length=-(-len(times) // FLEXHOUSE_BIT))
    heater = 0.043 + 5.18 * np.repeat(bits, FLEXHOUSE_BIT)[: len(times)] + 0.01 * rng.standard_normal(len(times))
    inputs = {"T_out": sky.outdoor, "u_heat": 1000.0 * heater, "I_sol": sky.irradiance}
    indoor = simulate(
        FLEXHOUSE,
        FLEXHOUSE_THETA,
        np.column_stack([inputs[channel] for channel in FLEXHOUSE.inputs]),
        FLEXHOUSE_PERIOD,
        x0=np.array([20.0, 17.0, 20.0]),
        process_noise_sd=0.01,
        rng=rng,
    )[:, 0]
    table = {
        "t": cells((times - start) / HOUR, 6),
        "Ta": cells(sky.outdoor, 4),
        "Ps": cells(sky.irradiance / 1000.0, 6),
        "Ph": cells(heater, 4),
        "yTi": cells(indoor + 0.01 * rng.standard_normal(len(times)), 4),
        "TimeDate": local_stamps(times),
    }
    return write_table(path, [f'"{name}"' for name in table], list(table.values()))


def write_ecolar(path: Path) -> Path:
    """Two days of October in the raw Ecolar layout, with one short gap and two late rows."""
    start = midnight(2025, 10, 7, ecolar.ZONE)
    period = ecolar.simulate_period(start, start + 2 * DAY, 3)
    return ecolar.write_raw(path, period, Faults(gaps=(20 * 60,), late_rows=2, missing=0.003), 3)


def write_generic(path: Path) -> Path:
    """Two days every 15 min as a European building system exports them: semicolons, decimal commas, local time."""
    rng = np.random.default_rng([5, 2])
    start = midnight(2025, 2, 3, ecolar.ZONE)
    times = np.arange(start, start + 2 * DAY, ecolar.GRID_STEP)
    local = wall_clock(times, ecolar.ZONE)
    sky = weather(times, KONSTANZ, 2)
    hour = local % DAY / HOUR
    network = titeth()
    loads = Loads(
        set_point=np.where((hour >= 6.0) & (hour < 22.0), 21.0, 18.0),
        forced=np.zeros((len(times), 1), dtype=bool),
        gain=habitual(GENERIC_PEOPLE, local, rng),
        opening=np.zeros(len(times)),
        noise=0.004 * rng.standard_normal((len(times), len(network.nodes))),
    )
    heated = simulate_heated(
        network,
        dynamics(network, GENERIC_THETA, ecolar.GRID_STEP),
        sky.outdoor[:, None],
        loads,
        (GENERIC_PANEL,),
        x0=np.array([19.0, 17.5, 19.0]),
    )
    quarter_hours = slice(None, None, 15)
    stamps = [datetime.fromtimestamp(int(second), UTC).strftime("%d.%m.%Y %H:%M") for second in local[quarter_hours]]
    noisy = heated.states[:, 0] + 0.05 * rng.standard_normal(len(times))
    table = {
        "Zeit": stamps,
        "Raumtemperatur": cells(noisy[quarter_hours], 2, ","),
        "Aussentemperatur": cells(sky.outdoor[quarter_hours], 1, ","),
        "Heizleistung_kW": cells(_quarter_means(heated.powers[:, 0]) / 1000.0, 3, ","),
    }
    return write_table(path, table, list(table.values()), delimiter=";")


def _quarter_means(minutes: Array) -> Array:
    """Mean (K / 15,) of a minute-wise series over the quarter-hour that follows each stamp."""
    means: Array = minutes.reshape(-1, 15).mean(axis=1)
    return means


def main() -> None:
    """Write the stand-ins where the command line says."""
    parser = argparse.ArgumentParser(prog="python -m replay.simulated.standins", description=__doc__)
    parser.add_argument("directory", type=Path, help="folder to write into")
    for path in write_standins(parser.parse_args().directory):
        print(path)


if __name__ == "__main__":
    main()
