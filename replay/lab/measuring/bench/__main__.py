"""`python -m replay.lab.measuring.bench`: measure everything in one run, as JSON and as part of a page."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from replay.lab.measuring.bench.machine import machine
from replay.lab.measuring.bench.section import SIZES
from service.daemon.process import prepare_process

SECTIONS = {
    **dict.fromkeys(("update", "threads", "growth"), "updates"),
    **dict.fromkeys(("months", "memory", "start", "fleet"), "processes"),
}
"""The module of each section, which has a function of its name."""
_PATIENCE = 3600.0
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
"""What is written lies between these lines of the page; the rest of it is a person's."""


def measure(name: str, size: str, out: Path) -> None:
    """Measure section `name` in this process and write what it found to `out`."""
    from importlib import import_module

    section = getattr(import_module(f"replay.lab.measuring.bench.{SECTIONS[name]}"), name)(SIZES[size])
    found = {
        "targets": [one._asdict() for one in section.targets],
        "details": [one._asdict() for one in section.details],
    }
    out.write_text(json.dumps(found), encoding="utf-8")


def measured(name: str, size: str) -> dict[str, Any]:
    """What section `name` found in a process of its own, which is neither slower nor larger for what another left
    behind; `failed` with the reason where it did not come to its end."""
    with TemporaryDirectory(prefix="thermogate-section-") as folder:
        out = Path(folder) / "section.json"
        module = "replay.lab.measuring.bench"
        command = [sys.executable, "-m", module, "--section", name, "--size", size, "--out", str(out)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE, check=False)
        except subprocess.TimeoutExpired:
            return {"failed": f"not done after {_PATIENCE:.0f} s"}
        if done.returncode != 0:
            return {"failed": (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]}
        found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
        return found


def targets(sections: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, str, str, str]]:
    """What was measured, the target, the figure, and `met`, `missed`, or why there is none."""
    for name, found in sections.items():
        if "failed" in found:
            yield name, "", f"failed: {found['failed']}", "no figure"
        for one in found.get("targets", ()):
            yield one["what"], one["target"], one["measured"], "met" if one["met"] else "missed"


def page(results: Mapping[str, Any]) -> list[str]:
    """The lines between BEGIN and END."""
    run, sections = results["machine"], results["sections"]
    lines = [f"**Size `{results['size']}`: these figures only show that the measurements run.**", ""]
    lines = [] if results["size"] == "full" else lines
    lines += [*_table(("machine", ""), list(run.items())), ""]
    for name, found in sections.items():
        own = found.get("machine", run)
        other = [f"{fact} {own[fact]}" for fact in ("processor", "commit", "date") if own[fact] != run[fact]]
        lines += [f"`{name}` was measured on: {', '.join(other)}.", ""] if other else []
    lines += _table(("work", "target", "measured", ""), list(targets(sections)))
    for found in sections.values():
        for one in found.get("details", ()):
            lines += ["", f"### {one['title']}", "", *([one["text"], ""] if one["text"] else [])]
            lines += _table(one["columns"], one["rows"])
    return lines


def _table(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    cells = [columns, ["---"] * len(columns), *rows]
    return ["| " + " | ".join(map(str, row)) + " |" for row in cells]


def write_page(path: Path, lines: Sequence[str]) -> None:
    """Put `lines` into the page, in place of those that an earlier run has put there."""
    before, _, rest = path.read_text(encoding="utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    path.write_text("\n".join([before + BEGIN, "", *lines, "", END + after]), encoding="utf-8")


def main() -> int:
    """Measure what the command line asks for; 1 if a section failed."""
    prepare_process()
    parser = argparse.ArgumentParser(prog="python -m replay.lab.measuring.bench", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("var/bench/bench.json"), help="where the JSON goes")
    parser.add_argument("--page", type=Path, help="write them into this page too, such as docs/performance.md")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, help="measure these sections anew, keep the others")
    parser.add_argument("--size", choices=SIZES, default="full", help="tiny: only to see that it runs")
    parser.add_argument("--section", choices=SECTIONS, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.section:
        measure(given.section, given.size, given.out)
        return 0
    given.out.parent.mkdir(parents=True, exist_ok=True)
    here = machine()
    results: dict[str, Any] = {"size": given.size, "machine": here, "sections": {}}
    if given.only and given.out.exists():
        results = json.loads(given.out.read_text(encoding="utf-8"))
    if results["size"] != given.size:
        parser.error(f"{given.out} has figures of the size {results['size']}; measure that, or give another --out")
    for name in given.only or SECTIONS:
        print(f"measuring {name} ...", file=sys.stderr, flush=True)
        # What is kept was measured on the machine and the commit of that run.
        results["sections"][name] = {"machine": here} | measured(name, given.size)
        # After every section, so that a run that is broken off leaves what it has.
        given.out.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    for what, target, figure, verdict in targets(results["sections"]):
        print(f"{verdict:9} {what}: {figure} (target: {target})")
    if given.page:
        write_page(given.page, page(results))
    return 1 if any("failed" in found for found in results["sections"].values()) else 0


if __name__ == "__main__":
    raise SystemExit(main())
