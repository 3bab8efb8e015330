"""`python -m replay.lab.measuring.fleet`: a fleet of zones on the real daemon, measured from outside."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from pathlib import Path

from estimator.errors import EstimatorError
from replay.errors import ReplayError
from replay.lab.measuring.fleet.report import lines
from replay.lab.measuring.fleet.run import run
from replay.lab.measuring.fleet.scenario import Scenario


def main() -> int:
    """Run the fleet that the command line describes, print its figures and write them as JSON."""
    parser = argparse.ArgumentParser(prog="python -m replay.lab.measuring.fleet", description=__doc__)
    parser.add_argument("--zones", type=int, default=1000, help="1 to 1,000 (default 1000)")
    parser.add_argument("--particles", type=int, default=9000, help="per zone (default 9000)")
    parser.add_argument("--network", default="building-67", help="preset of every zone (default building-67)")
    parser.add_argument("--every", type=float, default=10.0, help="s from one instant to the next (default 10)")
    parser.add_argument("--rounds", type=int, default=6, help="instants that are measured (default 6)")
    parser.add_argument("--clients", type=int, default=4, help="REST clients (default 4)")
    parser.add_argument("--pause", type=float, default=0.05, help="s that a client thinks (default 0.05)")
    parser.add_argument("--out", type=Path, default=Path("var/fleet"), help="folder, emptied first (default var/fleet)")
    given = parser.parse_args()
    if not 1 <= given.zones <= 1000 or given.rounds < 1 or given.clients < 1 or min(given.every, given.pause) <= 0:
        parser.error("zones are 1 to 1,000; rounds and clients at least 1; every and pause above 0")
    scenario = Scenario(given.zones, given.particles, given.network, given.every, given.rounds)
    for old in ("state", "compiled", "fleet.csv", "fleet.toml", "daemon.log"):
        path = given.out / old
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    try:
        result = run(scenario, given.out, clients=given.clients, pause=given.pause)
    except (ReplayError, EstimatorError) as error:
        print(f"fleet: {error}", file=sys.stderr)
        return 1
    (given.out / "fleet.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print("\n".join(lines(result)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
