"""Every fuzz target at length, each in a process of its own, two at a time: `make fuzz`.

    python tests/fuzz/run.py [--inputs 1000000] [--target NAME ...] [--out var/fuzz]

The inputs are spread over the targets by their shares. With atheris installed, coverage of `adapters` and `service`
leads to new ones; without, Hypothesis chooses them. A target fails on an exception, on an input that takes longer than
SECONDS, and on more memory than MEGABYTES; the input is then in OUT/<target>. OUT/report.json has the figures;
minutes are those of all processes together.
"""

from __future__ import annotations

import argparse
import importlib
import json
import logging
import os
import random
import re
import subprocess
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
SECONDS = 20
MEGABYTES = 4096
LONGEST_INPUT = 4096
AT_ONCE = 2
MODULES = [f"fuzz.{path.stem}" for path in sorted(Path(__file__).parent.glob("test_fuzz_*.py"))]


def main() -> int:
    """Run the targets, or with --child one of them in this process."""
    parser = argparse.ArgumentParser(description="Run every fuzz target at length.")
    parser.add_argument("--inputs", type=int, default=1_000_000)
    parser.add_argument("--target", nargs="*", default=[])
    parser.add_argument("--out", type=Path, default=ROOT / "var" / "fuzz")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        return run_one(arguments.child, arguments.inputs, arguments.out)
    return run_all(arguments.inputs, arguments.target, arguments.out.resolve())


def run_all(inputs: int, chosen: Iterable[str], out: Path) -> int:
    """Run the targets in processes, print a line for each, write the report; 1 if any of them failed."""
    targets = targets_of(MODULES)
    if unknown := set(chosen) - targets.keys():
        print(f"there is no target {', '.join(sorted(unknown))}; the targets are {', '.join(targets)}", file=sys.stderr)
        return 2
    whole = sum(target.share for target in targets.values())
    portions = {
        name: -(-inputs * target.share // whole) for name, target in targets.items() if not chosen or name in chosen
    }
    out.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        # Those that take longest first.
        order = sorted(portions, key=lambda name: targets[name].seeds != ())
        results = list(pool.map(lambda name: _in_a_process(name, portions[name], out), order))
    path = out / "report.json"
    if chosen and path.exists():
        # The others keep the figures of the run before.
        before = json.loads(path.read_text(encoding="utf-8"))["targets"]
        results += [result for result in before if result["target"] not in portions]
    report = {
        "inputs": sum(result["inputs"] for result in results),
        "crashes": sum(result["verdict"] == "crash" for result in results),
        "hangs": sum(result["verdict"] == "hang" for result in results),
        "minutes": round(sum(result["seconds"] for result in results) / 60, 1),
        "led_by": "coverage (atheris)" if find_spec("atheris") else "chance (hypothesis)",
        "targets": results,
    }
    path.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    print(f"{report['inputs']} inputs, {report['crashes']} crashes, {report['hangs']} hangs, {report['minutes']} min")
    return 1 if report["crashes"] or report["hangs"] else 0


def _in_a_process(name: str, inputs: int, out: Path) -> dict[str, Any]:
    folder = out / name
    (folder / "corpus").mkdir(parents=True, exist_ok=True)
    counted = folder / "inputs.json"
    counted.unlink(missing_ok=True)
    command = [sys.executable, __file__, "--child", name, "--inputs", str(inputs), "--out", str(folder)]
    began = time.monotonic()
    with (folder / "log").open("w", encoding="utf-8") as log:
        code = subprocess.run(command, stdout=log, stderr=log, cwd=ROOT, check=False).returncode
    text = (folder / "log").read_text(encoding="utf-8", errors="replace")
    figures = json.loads(counted.read_text()) if counted.exists() else {"inputs": 0}
    covered = re.findall(r"\bcov: (\d+)", text)
    hung = "libFuzzer: timeout" in text or "Timeout (0:00:" in text
    done = code == 0 and figures["inputs"] >= inputs
    result = {
        "target": name,
        **figures,
        "seconds": round(time.monotonic() - began, 1),
        "edges": int(covered[-1]) if covered else None,
        "verdict": "passed" if done else "hang" if hung else "crash",
    }
    print(" ".join(f"{key}={value}" for key, value in result.items()), flush=True)
    return result


def targets_of(modules: Iterable[str]) -> dict[str, Any]:
    """The targets that `modules` define, by name."""
    sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
    for module in modules:
        importlib.import_module(module)
    return dict(importlib.import_module("fuzz.fuzzing").TARGETS)


def run_one(name: str, inputs: int, folder: Path) -> int:
    """Give the target `inputs` inputs; the process ends when it has had them, or with the first failure."""
    logging.disable(logging.CRITICAL)
    if not find_spec("atheris"):
        return by_chance(targets_of(MODULES)[name], inputs, folder)
    import atheris

    # Compiled kernels cannot be instrumented, and the strategies need not be.
    with atheris.instrument_imports(include=["adapters", "service"], enable_loader_override=False):
        targets = targets_of(MODULES)
    target = targets[name]
    if target.run is None:
        return by_chance(target, inputs, folder)
    choose = random.Random(name)
    for index, seed in enumerate(target.seeds or [choose.randbytes(size) for size in (64, 256, 1024, 4096)]):
        (folder / "corpus" / f"seed-{index}").write_bytes(seed)
    count = Count(inputs, folder)

    def one(data: bytes) -> None:
        count.note(target.run(data) is not None)

    flags = [
        f"-timeout={SECONDS}",
        f"-rss_limit_mb={MEGABYTES}",
        f"-max_len={LONGEST_INPUT}",
        # Strategies need many bytes from the first input on.
        "-len_control=0",
        # The process ends itself; this is for the case that it does not.
        f"-runs={2 * inputs + 1000}",
        f"-artifact_prefix={folder}/",
    ]
    atheris.Setup([sys.argv[0], *flags, str(folder / "corpus")], one)
    atheris.Fuzz()
    return 0


class Count:
    """Counts inputs; bytes of which strategies could draw nothing are none."""

    def __init__(self, limit: int, folder: Path) -> None:
        self._limit, self._path = limit, folder / "inputs.json"
        self._inputs = 0

    def note(self, drawn: bool) -> None:
        """One more is through; ends the process with the last one."""
        self._inputs += drawn
        if drawn and (self._inputs % 1000 == 0 or self._inputs == self._limit):
            self._path.write_text(json.dumps({"inputs": self._inputs}))
        if self._inputs == self._limit:
            # libFuzzer knows no other way to stop that it does not count as a failure.
            sys.stderr.flush()
            os._exit(0)


def by_chance(target: Any, inputs: int, folder: Path) -> int:
    """Hypothesis chooses; an input that takes too long ends the process with a traceback."""
    import faulthandler

    from hypothesis import HealthCheck, given, settings

    count = Count(inputs, folder)

    def one(**drawn: Any) -> None:
        faulthandler.dump_traceback_later(SECONDS, exit=True)
        target.check(**drawn)
        faulthandler.cancel_dump_traceback_later()
        count.note(True)

    long = settings(
        max_examples=inputs, deadline=None, database=None, suppress_health_check=list(HealthCheck), print_blob=True
    )
    # It stops when it has seen everything that can be drawn, which may be less.
    while True:
        long(given(**target.strategies)(one))()


if __name__ == "__main__":
    sys.exit(main())
