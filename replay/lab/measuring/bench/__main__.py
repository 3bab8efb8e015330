"""`python -m replay.lab.measuring.bench`: measure everything in one run, as JSON and as part of a page."""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from replay.lab.measuring.bench.rows import SIZES, Row
from service.daemon.process import prepare_process

SECTIONS = {
    **dict.fromkeys(("update", "threads", "grown"), "updates"),
    **dict.fromkeys(("months", "memory", "start", "fleet"), "processes"),
}
"""The module of each section, which has a function of its name."""
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
"""What is written lies between these lines of the page; the rest of it is a person's."""
_LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "pydantic", "fastapi", "eclipse-zenoh")
_PATIENCE = 3600.0


def machine() -> dict[str, str]:
    """The machine and the software that figures belong to."""
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    facts: dict[str, str] = {}
    # Not there where the system is not Linux.
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            key, _, value = line.partition(":")
            facts.setdefault(key.strip(), value.strip())
    widest = "AVX-512" if "avx512f" in facts.get("flags", "").split() else "no AVX-512"
    family, model = (facts.get(key, "?") for key in ("cpu family", "model"))
    git = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty=+", "--exclude=*"]
    with suppress(OSError, subprocess.CalledProcessError):
        facts["commit"] = subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
    return {
        "processor": f"{facts.get('model name', platform.machine())} (family {family}, model {model}, {widest})",
        "cores": str(len(os.sched_getaffinity(0))),
        "memory": f"{memory / 1e9:.1f} GB",
        "system": f"{platform.system()} {platform.release()}, Python {platform.python_version()}",
        "libraries": ", ".join(f"{name} {version(name)}" for name in _LIBRARIES),
        "commit": facts.get("commit", "unknown"),
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "load average before": f"{os.getloadavg()[0]:.2f}",
    }


def measured(name: str, size: str) -> list[Row]:
    """The rows of section `name`, measured in a process of its own, which is neither slower nor larger for what
    another left behind; where it did not come to its end, a row that says why."""
    with TemporaryDirectory(prefix="thermogate-section-") as folder:
        out = Path(folder) / "section.json"
        module = "replay.lab.measuring.bench"
        command = [sys.executable, "-m", module, "--section", name, "--size", size, "--out", str(out)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE, check=False)
        except subprocess.TimeoutExpired:
            return [Row(name, "", f"failed: not done after {_PATIENCE:.0f} s", False)]
        if done.returncode != 0:
            reason = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
            return [Row(name, "", f"failed: {reason}", False)]
        return [Row(*row) for row in json.loads(out.read_text(encoding="utf-8"))]


def table(rows: Sequence[Sequence[object]]) -> list[str]:
    """`rows`, the first of which is the head, as Markdown."""
    cells = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
    return ["| " + " | ".join(map(str, row)) + " |" for row in cells]


def page(results: Mapping[str, Any]) -> list[str]:
    """The lines between BEGIN and END."""
    run, lines = results["machine"], []
    if results["size"] != "full":
        lines += [f"**Size `{results['size']}`: these figures only show that the measurements run.**", ""]
    lines += [*table([("machine", ""), *run.items()]), ""]
    for name, found in results["sections"].items():
        other = [f"{fact} {found['machine'][fact]}" for fact in ("processor", "commit", "date")]
        if other != [f"{fact} {run[fact]}" for fact in ("processor", "commit", "date")]:
            lines += [f"`{name}` was measured on: {', '.join(other)}.", ""]
    marks = {True: "met", False: "missed", None: ""}
    rows = [Row(*row) for found in results["sections"].values() for row in found["rows"]]
    return lines + table([("work", "target", "measured", ""), *((*row[:3], marks[row.met]) for row in rows)])


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
        module = import_module(f"replay.lab.measuring.bench.{SECTIONS[given.section]}")
        given.out.write_text(json.dumps(getattr(module, given.section)(SIZES[given.size])), encoding="utf-8")
        return 0
    given.out.parent.mkdir(parents=True, exist_ok=True)
    here = machine()
    results: dict[str, Any] = {"size": given.size, "machine": here, "sections": {}}
    if given.only and given.out.exists():
        results = json.loads(given.out.read_text(encoding="utf-8"))
    if results["size"] != given.size:
        parser.error(f"{given.out} has figures of the size {results['size']}; measure that, or give another --out")
    failed = False
    for name in given.only or SECTIONS:
        print(f"measuring {name} ...", file=sys.stderr, flush=True)
        rows = measured(name, given.size)
        failed |= any(row.measured.startswith("failed: ") for row in rows)
        # What is kept was measured on the machine and the commit of that run.
        results["sections"][name] = {"machine": here, "rows": rows}
        # After every section, so that a run that is broken off leaves what it has.
        given.out.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    lines = page(results)
    print("\n".join(lines))
    if given.page:
        write_page(given.page, lines)
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())
