"""A complete update in plain Numba against the kernels of `estimator`, with the machine's registers and with AVX2."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from typing import Any
from unittest.mock import patch

import numpy as np

from estimator.particle import rbpf
from estimator.particle.rbpf import RBPF
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
    """Both step from the same states, in turn, on one processor."""
    pin_to_one_processor()
    given = samples()
    kernels, plain = build(sizes.particles), build_plain(sizes.particles)
    settled(plain, given, 2)
    state = settled(kernels, given, sizes.settle)
    seconds: dict[str, list[float]] = {"kernels": [], "plain": []}
    apart = 0.0
    for index in range(sizes.settle, sizes.settle + sizes.repeats):
        now = given.at(index)
        taken, step = timed(lambda: complete_update(kernels, state, *now))  # noqa: B023
        seconds["kernels"].append(taken)
        taken, other = timed(lambda: complete_update(plain, state, *now))  # noqa: B023
        seconds["plain"].append(taken)
        apart = max(apart, float(np.abs(step.quantiles - other.quantiles).max()))
        state = step.state
    pairs = np.array(seconds["plain"]) / np.array(seconds["kernels"])
    return {
        "particles": sizes.particles,
        "kernels": spread(seconds["kernels"]),
        "plain": spread(seconds["plain"]),
        "ratio": float(np.median(pairs)),
        "largest_difference_K": apart,
    }


def plain(sizes: Sizes) -> Mapping[str, Any]:
    """The comparison on this machine as it is, and compiled for a processor without AVX-512."""
    size = next(name for name, known in SIZES.items() if known == sizes)
    command = [sys.executable, "-m", "replay.measuring.bench.plain", size]
    narrow = {"NUMBA_CPU_NAME": _AVX2, "NUMBA_CPU_FEATURES": ""}
    return {
        name: json.loads(
            subprocess.run(
                command, env=os.environ | changed, capture_output=True, text=True, timeout=_PATIENCE, check=True
            ).stdout
        )
        for name, changed in {"host": {}, "avx2": narrow}.items()
    }
