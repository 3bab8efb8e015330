"""Random numbers by position, not by history.

A zone's draws at step k come from the counter-based generator Philox4x32-10 (Salmon et al. 2011), keyed by the zone's
seed, with the step, the purpose and the index of the draw as counter. The whole state of the generator is therefore
(seed, step), which the checkpoint carries anyway: predicting twice, or after a restart, gives the same bits, and so
does any division of the work.

Draws have shape (rows, N): one counter gives particle n its draws of four rows. Normal deviates come from pairs of
words by Box and Muller, in single precision, which is far below anything that a Monte Carlo sum can see.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from estimator.arrays import Array
from estimator.kernels.elementary import single_precision_logarithm, single_precision_turn
from estimator.kernels.lanes import (
    DOUBLES,
    FLOATS,
    INTS,
    JIT,
    LANES,
    WORD,
    WORDS,
    Value,
    lanes,
    repeated,
    splat,
    store,
    within,
)

_MULTIPLIERS = (0xD2511F53, 0xCD9E8D57)
_WEYL = (0x9E3779B9, 0xBB67AE85)
_ROUNDS = 10
_LOW = 0xFFFFFFFF
_EXPONENT_52 = 0x4330000000000000
"""The bits of 2^52: with a 32-bit word in the low half, 2^52 plus that word."""

ROWS = 4
"""Rows of draws that one counter gives."""


class Purpose(IntEnum):
    """What draws are for; every purpose of every step has its own stream."""

    PRIOR_PARAMETERS = 0
    PRIOR_VOLATILITY = 1
    WALK = 2
    RESAMPLE = 5
    REJUVENATE = 6
    PRIOR_NOISE = 17
    PRIOR_GAIN = 18
    MIXTURE_WALK = 19
    MIXTURE_SWITCH = 20
    MIXTURE_SAMPLE = 21
    SCENARIO = 22
    SCENARIO_SWITCH = 23
    LAW = 24
    FORECAST = 8
    """Added to the purpose of a draw that belongs to a forecast, so that asking for one changes nothing."""


def _philox(builder: ir.IRBuilder, seed: ir.Value, step: ir.Value, counter: list[ir.Value]) -> list[ir.Value]:
    """Four vectors of 32-bit words (in 64-bit lanes) from the counter's first two words, the step and the key."""
    low, shift = repeated(WORDS, _LOW), repeated(WORDS, 32)

    def halves(scalar: ir.Value) -> list[ir.Value]:
        whole = splat(builder, scalar, WORDS)
        return [builder.and_(whole, low), builder.lshr(whole, shift)]

    c, key = [*counter, *halves(step)], halves(seed)
    for _ in range(_ROUNDS):
        # What the high halves of c hold does not matter: only low halves are multiplied.
        p = [builder.mul(builder.and_(c[2 * half], low), repeated(WORDS, _MULTIPLIERS[half])) for half in range(2)]
        c = [
            builder.xor(builder.xor(builder.lshr(p[1], shift), c[1]), key[0]),
            p[1],
            builder.xor(builder.xor(builder.lshr(p[0], shift), c[3]), key[1]),
            p[0],
        ]
        key = [builder.add(key[half], repeated(WORDS, _WEYL[half])) for half in range(2)]
    return [builder.and_(word, low) for word in c]


def _words(builder: ir.IRBuilder, stream: Sequence[ir.Value], row: ir.Value, first: ir.Value) -> list[ir.Value]:
    """Words of the particles first..first+7 for the four rows from `row` on; `stream` is seed, step and purpose."""
    seed, step, purpose = stream
    particle = builder.add(splat(builder, first, WORDS), ir.Constant(WORDS, list(range(LANES))))
    rows = builder.or_(purpose, builder.shl(row, ir.Constant(WORD, 8)))
    return _philox(builder, seed, step, [particle, splat(builder, rows, WORDS)])


def _normal_pair(builder: ir.IRBuilder, radius: ir.Value, angle: ir.Value) -> list[Value]:
    """sqrt(-2 log u) times cosine and sine of a uniform angle."""
    half = builder.lshr(builder.trunc(radius, INTS), repeated(INTS, 1))
    u = (Value(builder, builder.sitofp(half, FLOATS)) + 0.5) * 2.0**-31
    length = (single_precision_logarithm(u) * -2.0).sqrt()
    cosine, sine = single_precision_turn(u, builder.trunc(angle, INTS))
    return [u.of(builder.fpext((length * turn).value, DOUBLES)) for turn in (cosine, sine)]


def _uniform(builder: ir.IRBuilder, word: ir.Value) -> Value:
    biased = builder.bitcast(builder.or_(word, repeated(WORDS, _EXPONENT_52)), DOUBLES)
    return (Value(builder, biased) - 2.0**52 + 0.5) * 2.0**-32


def write_normals(builder: ir.IRBuilder, stream: Sequence[ir.Value], first: ir.Value, rows: int) -> list[Value]:
    """Standard normals of the rows 0..rows for the particles first..first+7; `stream` is seed, step and purpose."""
    normals: list[Value] = []
    for row in range(0, rows, ROWS):
        words = _words(builder, stream, ir.Constant(WORD, row), first)
        normals += _normal_pair(builder, *words[:2])
        if rows - row > 2:
            normals += _normal_pair(builder, *words[2:])
    return normals


def draw(convert: Any, rows: int) -> Any:
    """An intrinsic (seed, step, purpose, row, first) that gives a tuple of `rows` lanes."""
    result = types.UniTuple(lanes, rows)

    @intrinsic
    def function(typingctx, seed, step, purpose, row, first):  # type: ignore[no-untyped-def]
        def codegen(context, builder, sig, values):  # type: ignore[no-untyped-def]
            drawn = convert(builder, _words(builder, values[:3], *values[3:]))
            return context.make_tuple(builder, result, [value.value for value in drawn])

        return result(types.uint64, types.uint64, types.int64, types.int64, types.int64), codegen

    return function


normal_quad = draw(lambda builder, words: [*_normal_pair(builder, *words[:2]), *_normal_pair(builder, *words[2:])], 4)
"""Standard normals of the four rows from `row` on, a multiple of four, for the particles first..first+7."""
walk_draws = draw(lambda builder, words: [*_normal_pair(builder, *words[:2]), _uniform(builder, words[2])], 3)
"""Two standard normals, of the rows `row` and `row` + 1, and a uniform, of the row `row` + 2."""
uniform_quad = draw(lambda builder, words: [_uniform(builder, word) for word in words], 4)
"""Uniforms in (0, 1) of four rows."""


@njit(cache=True, **JIT)
def _fill(seed, step, purpose, normal, out):  # type: ignore[no-untyped-def]
    rows, particles = out.shape
    for first in range(0, particles, LANES):
        inside = within(first, particles)
        for row in range(0, rows, ROWS):
            if normal:
                drawn = normal_quad(seed, step, purpose, row, first)
            else:
                drawn = uniform_quad(seed, step, purpose, row, first)
            for part in range(min(ROWS, rows - row)):
                store(out, (row + part, first), inside, drawn[part])


class Draws:
    """The draws of one zone at one step; `forecast` selects the streams of a forecast from there."""

    def __init__(self, seed: int, step: int, *, forecast: bool = False) -> None:
        self.seed, self.step = np.uint64(seed), np.uint64(step)
        self._offset = Purpose.FORECAST if forecast else 0

    def stream(self, purpose: Purpose) -> int:
        """The number of a purpose's stream, for a kernel that draws for itself."""
        return int(purpose + self._offset)

    def normals(self, purpose: Purpose, shape: tuple[int, int]) -> Array:
        """Standard normals (rows, N)."""
        out = np.empty(shape)
        _fill(self.seed, self.step, self.stream(purpose), True, out)
        return out

    def uniforms(self, purpose: Purpose, shape: tuple[int, int]) -> Array:
        """Uniforms (rows, N) in (0, 1)."""
        out = np.empty(shape)
        _fill(self.seed, self.step, self.stream(purpose), False, out)
        return out
