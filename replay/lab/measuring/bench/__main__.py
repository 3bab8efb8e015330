"""`python -m replay.lab.measuring.bench`: measure everything in one run, as JSON and as a page with pictures."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from replay.lab.measuring.bench.catalogue import SECTIONS, measure, measured
from replay.lab.measuring.bench.machine import machine
from replay.lab.measuring.bench.report import page, table
from replay.lab.measuring.bench.sizes import SIZES
from service.daemon.process import prepare_process


def main() -> int:
    """Measure what the command line asks for; 1 if a section failed."""
    prepare_process()
    parser = argparse.ArgumentParser(prog="python -m replay.lab.measuring.bench", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("var/bench/bench.json"), help="where the JSON goes")
    parser.add_argument("--page", type=Path, help="also render this Markdown page, such as docs/performance.md")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, help="measure these sections anew, keep the others")
    parser.add_argument("--render", action="store_true", help="measure nothing, render the page from the JSON")
    parser.add_argument("--size", choices=SIZES, default="full", help="tiny: only to see that it runs")
    parser.add_argument("--section", choices=SECTIONS, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.section:
        measure(given.section, given.size, given.out)
        return 0
    given.out.parent.mkdir(parents=True, exist_ok=True)
    here = machine()
    results = {"schema": 1, "size": given.size, "machine": here, "sections": {}}
    if (given.only or given.render) and given.out.exists():
        results = json.loads(given.out.read_text(encoding="utf-8"))
    if not given.render:
        if results["size"] != given.size:
            parser.error(f"{given.out} has figures of the size {results['size']}; measure that, or give another --out")
        for name in given.only or SECTIONS:
            print(f"measuring {name} ...", file=sys.stderr, flush=True)
            # What is kept was measured on the machine and the commit of that run.
            results["sections"][name] = {"machine": here} | measured(name, given.size)
            # After every section, so that a run that is broken off leaves what it has.
            given.out.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    print("\n".join(table(results["sections"])))
    if given.page:
        page(results, given.page)
    failed = [name for name, found in results["sections"].items() if "failed" in found]
    for name in failed:
        print(f"bench: {name} failed: {results['sections'][name]['failed']}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
