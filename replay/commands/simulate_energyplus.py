"""`thermogate simulate-energyplus`: a recording of a building that EnergyPlus simulates, with the truth beside it."""

from __future__ import annotations

import argparse
import sys
from datetime import date
from pathlib import Path

from service.cli.arguments import AddCommand, whole

_FIRST_DAY = "2025-01-06"


def add_to(add: AddCommand) -> None:
    """Add the command by `add(name, command, text)`."""
    parser = add(
        "simulate-energyplus", simulate, "Record a building that EnergyPlus simulates, with the truth beside it."
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the files")
    parser.add_argument("--building", default="house", metavar="NAME", help="house, timber or office (default house)")
    parser.add_argument(
        "--weather",
        default="denver",
        metavar="NAME|EPW",
        help="chicago, denver, san-francisco, tampa or washington, or the path of an EPW file (default denver)",
    )
    parser.add_argument(
        "--heating", default="on-off", metavar="NAME", help="on-off, proportional or planned (default on-off)"
    )
    parser.add_argument(
        "--begin", type=_day, default=_FIRST_DAY, metavar="DATE", help=f"first day (default {_FIRST_DAY})"
    )
    parser.add_argument("--days", type=whole(1, 3660), default=28, metavar="N", help="how many days (default 28)")
    parser.add_argument("--seed", type=whole(0, 2**63 - 1), default=1, metavar="N", help="of the people (default 1)")


def simulate(arguments: argparse.Namespace) -> int:
    """Write the files that the arguments ask for; 0. ReplayError where that cannot be done."""
    import numpy as np
    from tqdm import tqdm

    from replay.energyplus.buildings import building_named
    from replay.energyplus.files import write_recording
    from replay.energyplus.heat_loss import heat_loss
    from replay.energyplus.recording import record

    building = building_named(arguments.building)
    with tqdm(total=arguments.days, unit="day", disable=not sys.stderr.isatty(), leave=False) as bar:
        recording = record(
            building,
            arguments.weather,
            begin=arguments.begin,
            days=arguments.days,
            heating=arguments.heating,
            seed=arguments.seed,
            tick=bar.update,
        )
    outdoor, wind = float(np.mean(recording.outdoor)), float(np.mean(recording.wind))
    loss = heat_loss(building, recording.weather, outdoor=outdoor, wind=wind)
    config = write_recording(arguments.out, recording, loss)
    print(f"{arguments.days} days of {building.what} in {arguments.out}; thermogate replay {config} --out results")
    return 0


def _day(text: str) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no day such as {_FIRST_DAY}") from None
