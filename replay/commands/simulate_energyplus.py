"""`thermogate simulate-energyplus`: a recording of a building that EnergyPlus simulates, with the truth beside it."""

import argparse
import sys
from datetime import date
from pathlib import Path

from replay.commands.options import Option, add_options
from service.cli.arguments import AddCommand, whole

_FIRST_DAY = "2025-01-06"


def add_to(add: AddCommand) -> None:
    parser = add(
        "simulate-energyplus", simulate, "Record a building that EnergyPlus simulates, with the truth beside it."
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the files")
    options: dict[str, Option] = {
        "--building": (str, "house", "NAME", "house, timber or office"),
        "--weather": (
            str,
            "denver",
            "NAME|EPW",
            "chicago, denver, san-francisco, tampa or washington, or the path of an EPW file",
        ),
        "--heating": (str, "on-off", "NAME", "on-off, proportional or planned"),
        "--begin": (_day, _FIRST_DAY, "DATE", "first day"),
        "--days": (whole(1, 3660), "28", "N", "how many days"),
        "--seed": (whole(0, 2**63 - 1), "1", "N", "seed of the people"),
    }
    add_options(parser, options)


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
