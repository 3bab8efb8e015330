"""Every target of speed and memory, measured in one run, as a part of docs/performance.md: `make bench`.

    python tests/bench/run.py --page docs/performance.md
    python tests/bench/run.py --only fleet

Each section is measured in a process of its own, which is neither slower nor larger for what another left behind.
"""

import argparse
import multiprocessing
import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from datetime import UTC, datetime
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from bench.rows import SIZES, Row

from service.daemon.process import prepare_process

SECTIONS = {
    **dict.fromkeys(("update", "threads", "grown"), "updates"),
    **dict.fromkeys(("months", "memory", "start", "fleet"), "daemons"),
}
"""The module of each section, which has a function of its name."""
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
"""What is written lies between these lines of the page; the rest of it is a person's."""
_LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "pydantic", "fastapi", "eclipse-zenoh")
_MARKS = {True: "met", False: "missed", None: ""}


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
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    return {
        "processor": f"{facts.get('model name', platform.machine())} (family {family}, model {model}, {widest})",
        "cores": str(len(os.sched_getaffinity(0))),
        "memory": f"{memory / 1e9:.1f} GB",
        "system": f"{platform.system()} {platform.release()}, Python {platform.python_version()}",
        "libraries": ", ".join(f"{name} {version(name)}" for name in _LIBRARIES),
        "commit": commit or "unknown",
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "load average before": f"{os.getloadavg()[0]:.2f}",
    }


def measured(name: str, size: str) -> list[Row]:
    """The rows of section `name`; where it did not come to its end, a row that says why."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        try:
            return pool.submit(_section, name, size).result()
        except Exception as error:
            return [Row(name, "", f"failed: {(str(error).strip().splitlines() or [repr(error)])[-1]}", False)]


def _section(name: str, size: str) -> list[Row]:
    # Where compiled kernels are kept is chosen before the sections import Numba.
    prepare_process()
    return getattr(import_module(f"bench.{SECTIONS[name]}"), name)(SIZES[size])


def table(rows: Sequence[Sequence[object]]) -> list[str]:
    """`rows`, the first of which is the head, as Markdown."""
    cells = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
    return ["| " + " | ".join(map(str, row)) + " |" for row in cells]


def write_page(path: Path, lines: Sequence[str]) -> None:
    """Put `lines` into the page, in place of those that an earlier run has put there."""
    before, _, rest = path.read_text(encoding="utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    path.write_text("\n".join([before + BEGIN, "", *lines, "", END + after]), encoding="utf-8")


def main(words: Sequence[str] | None = None) -> int:
    """Measure what the command line asks for; 1 if a section failed."""
    parser = argparse.ArgumentParser(description="measure every target of speed and memory")
    parser.add_argument("--page", type=Path, help="write the figures into this page, such as docs/performance.md")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=[*SECTIONS], help="these sections")
    parser.add_argument("--size", choices=SIZES, default="full", help="tiny: only to see that it runs")
    given = parser.parse_args(words)
    lines = [*table([("machine", ""), *machine().items()]), ""]
    if given.size != "full":
        lines += ["**These figures only show that the measurements run.**", ""]
    rows: list[Row] = []
    for name in given.only:
        print(f"measuring {name} ...", file=sys.stderr, flush=True)
        rows += measured(name, given.size)
    lines += table([("work", "target", "measured", ""), *((*row[:3], _MARKS[row.met]) for row in rows)])
    print("\n".join(lines))
    if given.page:
        write_page(given.page, lines)
    return int(any(row.measured.startswith("failed: ") for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
