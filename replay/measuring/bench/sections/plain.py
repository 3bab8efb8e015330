"""A complete update in plain Numba against the kernels of `estimator`, with the machine's registers and with AVX2."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np

from estimator.particle import rbpf
from estimator.particle.rbpf import RBPF
from replay.measuring.bench.machine import machine
from replay.measuring.bench.plain.steps import PlainSteps
from replay.measuring.bench.sizes import SIZES, Sizes
from replay.measuring.bench.workload import (
    build,
    complete_update,
    pin_to_one_processor,
    samples,
    settled,
    spread,
    timed,
)

_AVX2 = "x86-64-v3"
"""LLVM's name for any x86 processor with AVX2 and fused multiply-add, and without AVX-512."""
_PATIENCE = 1200.0


def build_plain(particles: int) -> RBPF:
    """`build`, on plain Numba."""
    with patch.object(rbpf, "CompiledSteps", PlainSteps):
        return build(particles)


def compared(sizes: Sizes) -> dict[str, Any]:
    """Both step from the same states, in turn, on one processor.

    Elapsed time grows with the load of the machine; the processor time of the thread hardly does. What the first
    updates take includes compilation if Numba's cache is empty.
    """
    pin_to_one_processor()
    given = samples()
    kernels, plain = build(sizes.particles), build_plain(sizes.particles)
    first = {}
    for name, one in {"kernels": kernels, "plain": plain}.items():
        began = time.process_time()
        settled(one, given, 2)
        first[name] = time.process_time() - began
    state = settled(kernels, given, sizes.settle)
    seconds: dict[str, list[float]] = {"kernels": [], "plain": []}
    processor: dict[str, list[float]] = {"kernels": [], "plain": []}
    apart = 0.0
    for index in range(sizes.settle, sizes.settle + sizes.repeats):
        now = given.at(index)
        steps = {}
        for name, one in {"kernels": kernels, "plain": plain}.items():
            began = time.thread_time()
            taken, steps[name] = timed(lambda: complete_update(one, state, *now))  # noqa: B023
            seconds[name].append(taken)
            processor[name].append(time.thread_time() - began)
        apart = max(apart, float(np.abs(steps["kernels"].quantiles - steps["plain"].quantiles).max()))
        state = steps["kernels"].state
    return {
        "particles": sizes.particles,
        "kernels": spread(seconds["kernels"]),
        "plain": spread(seconds["plain"]),
        "ratio": _ratio(seconds),
        "processor_ratio": _ratio(processor),
        "first_updates_processor_s": first,
        "largest_difference_K": apart,
    }


def _ratio(seconds: Mapping[str, list[float]]) -> float:
    """The median over pairs of how many times as long the plain version takes."""
    return float(np.median(np.array(seconds["plain"]) / np.array(seconds["kernels"])))


def plain(sizes: Sizes) -> Mapping[str, Any]:
    """The comparison for this processor and for one without AVX-512, each with an empty kernel cache."""
    size = next(name for name, known in SIZES.items() if known == sizes)
    command = [sys.executable, "-m", "replay.measuring.bench.plain", size]
    found: dict[str, Any] = {"machine": machine()}
    for name, changed in {"host": {}, "avx2": {"NUMBA_CPU_NAME": _AVX2, "NUMBA_CPU_FEATURES": ""}}.items():
        with TemporaryDirectory(prefix="thermogate-plain-") as cache:
            environment = os.environ | changed | {"NUMBA_CACHE_DIR": cache}
            done = subprocess.run(
                command, env=environment, capture_output=True, text=True, timeout=_PATIENCE, check=True
            )
        found[name] = json.loads(done.stdout)
    return found
