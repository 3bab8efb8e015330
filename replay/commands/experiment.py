"""`thermogate experiment NAME`: its arguments, and what they start."""

import argparse
import os
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

from replay.experiments.catalogue import EXPERIMENTS, module_of
from service.cli.arguments import AddCommand, whole

_DEFAULT_OUT = Path("var/experiments")


def add_to(add: AddCommand) -> None:
    parser = add(
        "experiment", _experiment, "Score forecasts and parameters on simulated or recorded buildings, into a report."
    )
    listed = "; ".join(f"{name}: {entry.text}" for name, entry in EXPERIMENTS.items())
    parser.add_argument("name", choices=EXPERIMENTS, metavar="NAME", help=listed)
    parser.add_argument(
        "--data",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="recorded data: a CSV file; hours-ahead, first-days: the folder of the recordings",
    )
    parser.add_argument(
        "--seeds",
        type=_seeds,
        default=(),
        metavar="N|A,B,...",
        help="how many seeds ('5': seeds 1 to 5), or which ones, with a comma ('3,7'; '7,' for one alone) "
        "(default: the experiment's own)",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help=f"folder for runs and report (default {_DEFAULT_OUT}/NAME)"
    )
    parser.add_argument(
        "--days",
        type=whole(1, 3660),
        metavar="N",
        help="only the first N days of the data; control, first-days, preheat: how many days",
    )
    parser.add_argument("--particles", type=whole(50, 1_000_000), metavar="N", help="particles of every RBPF")
    parser.add_argument(
        "--config", type=Path, metavar="CONFIG", help="configuration with the zone (topology, hours-ahead)"
    )
    parser.add_argument(
        "--state", type=Path, metavar="STATE_DIR", help="state folder of a daemon, in place of a recording (topology)"
    )
    parser.add_argument("--zone", metavar="ID", help="which zone of --config or --state (default: its only one)")
    for name, value, meaning in (
        ("--building", "NAME", "a building of EnergyPlus (control, preheat, lies; repeatable)"),
        ("--case", "NAME", "one case (control; repeatable)"),
        ("--recording", "NAME", "one recording (hours-ahead) or site (first-days); repeatable"),
        (
            "--contender",
            "NAME[:OPTIONS]",
            "what takes part, such as bank or mkf:particles=64 (hours-ahead, first-days; repeatable)",
        ),
    ):
        parser.add_argument(name, action="append", default=[], metavar=value, help=meaning)
    parser.add_argument(
        "--jobs", type=whole(1, 256), metavar="N", help="processes (default: as many as there are processors)"
    )


def _experiment(arguments: argparse.Namespace) -> int:
    from replay.errors import writing
    from replay.experiments.jobs import run_jobs
    from replay.experiments.request import Request
    from replay.experiments.study import Study
    from replay.reports.kit.report import write_report

    out: Path = arguments.out or _DEFAULT_OUT / arguments.name
    given: dict[str, Any] = {field.name: getattr(arguments, field.name) for field in fields(Request)}
    given |= {name: tuple(value) for name, value in given.items() if isinstance(value, list)}
    request = Request(**given)
    watched = sys.stderr.isatty()
    if watched:
        print(f"preparing {arguments.name}", file=sys.stderr)
    workers = arguments.jobs or len(os.sched_getaffinity(0))
    # Finished runs are used again where neither their settings nor the code has changed.
    runs = out / "runs"
    try:
        study: Study = module_of(arguments.name).prepare(request)
        with writing(out):
            runs.mkdir(exist_ok=True)
            results = run_jobs(study.jobs, runs, workers, watched)
        written = write_report(study.report(results), out)
    except KeyboardInterrupt:
        kept = len(list(runs.glob("*.npz")))
        print(
            f"thermogate: interrupted; {kept} finished runs are kept in {runs}, the same command goes on from there",
            file=sys.stderr,
        )
        return 130
    for path in written:
        if path.suffix == ".toml":
            print(path.read_text(encoding="utf-8"))
    print(f"{sum(path.suffix == '.csv' for path in written)} tables in {out}; read {written[0]}")
    return 0


def _seeds(text: str) -> tuple[int, ...]:
    words = [word for word in text.split(",") if word]
    if not words or not all(word.isdecimal() and int(word) < 2**63 for word in words):
        raise argparse.ArgumentTypeError(f"{text!r} is neither a number of seeds nor a list of them such as 1,2,5")
    numbers = tuple(dict.fromkeys(int(word) for word in words))
    if "," in text:
        return numbers
    if not 1 <= numbers[0] <= 1000:
        raise argparse.ArgumentTypeError(f"{text} seeds; from 1 to 1000 are possible, and {text}, is seed {text} alone")
    return tuple(range(1, numbers[0] + 1))
