"""Scalar code without loops over states, written from `estimator.kernels.algebra`: source text that Numba compiles.

Numba unrolls no loop over rows and columns, and LLVM turns none but the innermost loop into vector instructions, so the
algebra of n states has to stand in the loop over particles element by element. The functions of
`estimator.kernels.algebra` are run once with `Symbol`s, which note down every operation as a line of Python.

Scratch memory is one array of rows of WIDTH numbers, a particle to each place: all offsets between rows are constants,
so LLVM knows without a check at run time that no row overlaps another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numba import njit
from numba.extending import overload

from estimator.kernels.lanes import JIT

WIDTH = 32
"""Particles of a block: enough that loops over them are long, few enough that their rows stay in the nearest cache."""


class Symbol:
    """A number in code that is being written, by its name or its digits."""

    def __init__(self, lines: list[str], name: str) -> None:
        self.lines, self.name = lines, name

    def __add__(self, other: Any) -> Symbol:
        return self._noted(f"{self.name} + {_named(other)}")

    def __sub__(self, other: Any) -> Symbol:
        return self._noted(f"{self.name} - {_named(other)}")

    def __mul__(self, other: Any) -> Symbol:
        return self._noted(f"{self.name} * {_named(other)}")

    def __truediv__(self, other: Any) -> Symbol:
        return self._noted(f"{self.name} / {_named(other)}")

    def __rtruediv__(self, other: Any) -> Symbol:
        return self._noted(f"{_named(other)} / {self.name}")

    __radd__, __rmul__ = __add__, __mul__

    def __abs__(self) -> Symbol:
        return self._noted(f"abs({self.name})")

    def sqrt(self) -> Symbol:
        """The square root."""
        return self._noted(f"np.sqrt({self.name})")

    def maximum(self, other: Symbol) -> Symbol:
        """The larger of both."""
        return self._noted(f"{self.name} if {self.name} > {other.name} else {other.name}")

    def _noted(self, line: str) -> Symbol:
        name = f"v{len(self.lines)}"
        self.lines.append(f"{name} = {line}")
        return Symbol(self.lines, name)


def _named(value: Any) -> str:
    return value.name if isinstance(value, Symbol) else repr(float(value))


class Rows:
    """Scratch rows in code that is being written."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.starts: dict[str, np.uint64] = {}
        """Where rows begin; unsigned, so that there is no negative index to be looked out for."""

    def read(self, first: int, count: int) -> list[Symbol]:
        """Rows first..first+count."""
        symbols = []
        for row in range(first, first + count):
            name = f"v{len(self.lines)}"
            self.starts[f"r{row}"] = np.uint64(row * WIDTH)
            self.lines.append(f"{name} = s[r{row} + w]")
            symbols.append(Symbol(self.lines, name))
        return symbols

    def write(self, first: int, values: Sequence[Symbol]) -> None:
        """Rows from `first` on."""
        for row, value in enumerate(values, first):
            self.starts[f"r{row}"] = np.uint64(row * WIDTH)
            self.lines.append(f"s[r{row} + w] = {value.name}")


def operation(write: Callable[[Rows, int], None], count: int) -> Any:
    """An operation on scratch rows, written by `write(rows, n)`, as a function (size, s, first) in kernels.

    `size` is a tuple of n entries: its type says for how many states the code is to be written. The `count` places from
    `first` on (uint64) are handled.
    """

    def function(size, s, first):  # type: ignore[no-untyped-def]
        raise NotImplementedError("for kernels only")

    @overload(function, jit_options=JIT)
    def written(size, s, first):  # type: ignore[no-untyped-def]
        rows = Rows()
        write(rows, size.count)
        lines = ["def code(size, s, first):", "  for place in range(COUNT):", "    w = first + place"]
        names: dict[str, Any] = {"np": np, "COUNT": np.uint64(count)} | rows.starts
        exec("\n".join([*lines, *(f"    {line}" for line in rows.lines)]), names)
        return names["code"]

    return function


@njit(**JIT)
def aligned(rows):  # type: ignore[no-untyped-def]
    """`rows` scratch rows that begin at a cache line, all ones."""
    memory = np.ones((rows + 1) * WIDTH)
    return memory[(-memory.ctypes.data % 64) // 8 :]
