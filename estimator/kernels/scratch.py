"""Scratch memory of a kernel: rows of eight numbers, aligned to the processor's cache lines.

What is computed for one block of particles stays here between two operations, in the nearest cache.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from estimator.kernels.lanes import DOUBLES, JIT, LANES, WORD, Value, as_value, lanes

_LINE = 8 * LANES
"""Bytes of a row, and of a cache line."""


@intrinsic
def _address(typingctx, array):  # type: ignore[no-untyped-def]
    def codegen(context, builder, sig, values):  # type: ignore[no-untyped-def]
        data = context.make_array(sig.args[0])(context, builder, values[0]).data
        return builder.ptrtoint(data, WORD)

    return types.int64(array), codegen


def aligned(memory):  # type: ignore[no-untyped-def]
    """The part of a float64 array that begins at a cache line."""
    skip = -_address(memory) % _LINE
    return memory[skip // 8 :]


aligned = njit(**JIT)(aligned)


class Rows:
    """Scratch rows in code that is being written."""

    def __init__(self, context: Any, builder: ir.IRBuilder, kind: types.Array, array: ir.Value) -> None:
        self._builder = builder
        self._data = context.make_array(kind)(context, builder, array).data

    def read(self, first: int, count: int) -> list[Value]:
        """Rows first..first+count."""
        return [Value(self._builder, self._load(row)) for row in range(first, first + count)]

    def write(self, first: int, values: Sequence[Value]) -> None:
        """Rows from `first` on."""
        for row, value in enumerate(values, first):
            self._builder.store(value.value, self._pointer(ir.Constant(WORD, row * LANES)), align=_LINE)

    def _load(self, row: int) -> ir.Value:
        return self._builder.load(self._pointer(ir.Constant(WORD, row * LANES)), align=_LINE)

    def _pointer(self, place: ir.Value) -> ir.Value:
        return self._builder.bitcast(self._builder.gep(self._data, [place]), DOUBLES.as_pointer())


def operation(write: Callable[[Rows, int], None]) -> Any:
    """An operation on scratch rows, written by `write(rows, n)`, as a function (size, scratch) in kernels.

    `size` is a tuple of n entries: its type says for how many states the code is to be written.
    """

    @intrinsic
    def function(typingctx, size, scratch):  # type: ignore[no-untyped-def]
        def codegen(context, builder, sig, values):  # type: ignore[no-untyped-def]
            write(Rows(context, builder, sig.args[1], values[1]), sig.args[0].count)
            return context.get_dummy_value()

        return types.void(size, scratch), codegen

    return function


@intrinsic
def get(typingctx, scratch, row):  # type: ignore[no-untyped-def]
    """A scratch row."""

    def codegen(context, builder, sig, values):  # type: ignore[no-untyped-def]
        return builder.load(_row(context, builder, sig.args[0], values), align=_LINE)

    return lanes(scratch, types.int64), codegen


@intrinsic
def put(typingctx, scratch, row, value):  # type: ignore[no-untyped-def]
    """A scratch row becomes `value`, lanes or one number for all of them."""

    def codegen(context, builder, sig, values):  # type: ignore[no-untyped-def]
        row = as_value(context, builder, sig.args[2], values[2])
        builder.store(row.value, _row(context, builder, sig.args[0], values), align=_LINE)
        return context.get_dummy_value()

    return types.void(scratch, types.int64, value), codegen


def _row(context: Any, builder: ir.IRBuilder, kind: types.Array, values: Sequence[ir.Value]) -> ir.Value:
    data = context.make_array(kind)(context, builder, values[0]).data
    place = builder.mul(values[1], ir.Constant(WORD, LANES))
    return builder.bitcast(builder.gep(data, [place]), DOUBLES.as_pointer())
