"""`python -m replay.lab.measuring.soak`: simulated days of the real daemon in restless company."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from pathlib import Path

from replay.errors import ReplayError
from replay.lab.measuring.soak.report import draw, lines, write_page
from replay.lab.measuring.soak.run import Soak, run


def main() -> int:
    """Run the soak that the command line describes; 0 if everything stayed within its limits."""
    usual = Soak()
    parser = argparse.ArgumentParser(prog="python -m replay.lab.measuring.soak", description=__doc__)
    parser.add_argument("--hours", type=float, default=usual.hours, help="simulated (default 96)")
    parser.add_argument("--pace", type=float, default=usual.pace, help="simulated s per s, to 3600 (default 600)")
    parser.add_argument("--zones", type=int, default=usual.zones, help="rooms (default 4)")
    parser.add_argument("--particles", type=int, default=usual.particles, help="per zone (default 3000)")
    parser.add_argument("--streams", type=int, default=usual.streams, help="streams at a time (default 6)")
    parser.add_argument("--seed", type=int, default=usual.seed, help="of building, faults and clients (default 1)")
    parser.add_argument("--out", type=Path, default=Path("var/soak"), help="folder, emptied first (default var/soak)")
    parser.add_argument("--picture", type=Path, help="SVG of the curves, with the extra 'bench'")
    given = parser.parse_args()
    if given.hours <= 0 or not 1 <= given.pace <= 3600 or not 1 <= given.zones <= 80 or given.particles < 1:
        parser.error("hours and particles are above 0, pace is 1 to 3600, zones are 1 to 80")
    shutil.rmtree(given.out, ignore_errors=True)
    soak = Soak(given.hours, given.pace, given.zones, given.particles, streams=given.streams, seed=given.seed)
    try:
        result, observations, verdicts = run(soak, given.out)
    except ReplayError as error:
        print(f"soak: {error}", file=sys.stderr)
        return 1
    text = lines(result, verdicts)
    report = result | {
        "verdicts": [one._asdict() | {"limit": one.limit._asdict()} for one in verdicts],
        "observations": [one._asdict() for one in observations],
    }
    (given.out / "soak.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    write_page(given.out / "soak.html", observations, soak.pace, text)
    if given.picture is not None and not draw(given.picture, observations, soak.pace):
        print("soak: no picture without matplotlib; pip install 'thermogate[bench]'", file=sys.stderr)
    print("\n".join(text))
    return 0 if all(one.within for one in verdicts) else 1


if __name__ == "__main__":
    raise SystemExit(main())
