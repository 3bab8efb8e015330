"""Straight-line lane code for networks of n states, written out by the number of states.

The matrices of a zone are tiny. Written out element by element, one loop over the lanes of a block holds a whole matrix
product, which the compiler turns into vector instructions without a load or store between them; the same loops
over i, j and k with lanes innermost are ten times slower. Each operation is an overload on the type of a tuple
of n entries (`size`), so the kernels that call it are ordinary, cached Numba functions, compiled once per n.

All operations work on one flat scratch array of rows of LANES lanes; `Layout` names the rows. Matrices are packed lower
triangles.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

LANES = 64
"""Particles that are handled together."""

JIT: Any = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
"""Only the fusing of multiply and add is allowed, which is deterministic and more exact than two roundings."""

TAYLOR_DEGREE = 12
SMALL_NORM = 0.35
"""Norm below which the degree-12 polynomial of exp(M) - 1 is exact to rounding: .35^12 / 13! = 5e-16."""


class Layout(NamedTuple):
    """First row of each quantity of an n-state network in the scratch array, and the number of rows."""

    conductance: int
    flow: int
    root: int
    inverse_root: int
    steady: int
    decay: int
    norm: int
    mean: int
    covariance: int
    noise: int
    rows: int


def triangle(n: int) -> int:
    """Entries of a packed n x n triangle."""
    return n * (n + 1) // 2


def packed(i: int, j: int) -> int:
    """Place of (i, j) in a packed triangle."""
    return i * (i + 1) // 2 + j if i >= j else j * (j + 1) // 2 + i


def layout(n: int) -> Layout:
    """The scratch rows of an n-state network."""
    sizes = (triangle(n), n, n, n, n, triangle(n), 1, n, triangle(n), n)
    starts = [sum(sizes[:index]) for index in range(len(sizes) + 1)]
    return Layout(*starts)


def _function(signature: str, body: list[str], once: Sequence[str] = ()) -> Callable[..., None]:
    """A function with `signature`, such as "square(size, s)", that runs `body` for every lane w of scratch s.

    What all lanes share is computed by `once` before.
    """
    loop = [f"    for w in range({LANES}):", *(f"        {line}" for line in body)]
    text = "\n".join([f"def {signature}:", *(f"    {line}" for line in once), *loop])
    names: dict[str, Any] = {"sqrt": np.sqrt, "abs": abs, "max": max}
    exec(text, names)
    function: Callable[..., None] = names[signature.partition("(")[0]]
    return function


def _at(row: int) -> str:
    return f"s[{row * LANES} + w]"


def _load(name: str, first: int, count: int) -> list[str]:
    return [f"{name}{t} = {_at(first + t)}" for t in range(count)]


def _store(name: str, first: int, count: int) -> list[str]:
    return [f"{_at(first + t)} = {name}{t}" for t in range(count)]


def _product(out: str, left: str, right: str, n: int) -> list[str]:
    """out = left @ right for commuting symmetric matrices."""
    return [
        f"{out}{packed(i, j)} = " + " + ".join(f"{left}{packed(i, k)} * {right}{packed(k, j)}" for k in range(n))
        for i in range(n)
        for j in range(i + 1)
    ]


def _steady_state_source(n: int) -> list[str]:
    """x_ss of G x_ss = B u by an LDL^T factorisation."""
    rows = layout(n)
    lines = _load("g", rows.conductance, triangle(n)) + _load("x", rows.flow, n)
    for j in range(n):
        # g_jj becomes 1 / D_j, g_ij below it L_ij.
        reduced = "".join(f" - l{packed(j, k)} * g{packed(j, k)}" for k in range(j))
        lines.append(f"d{j} = 1.0 / (g{packed(j, j)}{reduced})")
        for i in range(j + 1, n):
            reduced = "".join(f" - l{packed(j, k)} * g{packed(i, k)}" for k in range(j))
            lines.append(f"g{packed(i, j)} = g{packed(i, j)}{reduced}")
            lines.append(f"l{packed(i, j)} = g{packed(i, j)} * d{j}")
    for i in range(n):
        lines.append(f"x{i} = x{i}" + "".join(f" - l{packed(i, k)} * x{k}" for k in range(i)))
    lines += [f"x{i} = x{i} * d{i}" for i in range(n)]
    for i in reversed(range(n)):
        lines.append(f"x{i} = x{i}" + "".join(f" - l{packed(k, i)} * x{k}" for k in range(i + 1, n)))
    return lines + _store("x", rows.steady, n)


def _scale_source(n: int) -> list[str]:
    """C^(-1/2) G C^(-1/2) from the capacitances in `root`, with their roots, inverse roots and its norm."""
    rows = layout(n)
    lines = _load("c", rows.root, n) + _load("g", rows.conductance, triangle(n))
    lines += [f"r{i} = sqrt(c{i})" for i in range(n)] + [f"v{i} = 1.0 / r{i}" for i in range(n)]
    lines += [f"m{packed(i, j)} = g{packed(i, j)} * v{i} * v{j}" for i in range(n) for j in range(i + 1)]
    for i in range(n):
        lines.append(f"a{i} = " + " + ".join(f"abs(m{packed(i, j)})" for j in range(n)))
    norm = "a0"
    for i in range(1, n):
        norm = f"max({norm}, a{i})"
    lines.append(f"{_at(rows.norm)} = {norm}")
    return lines + _store("r", rows.root, n) + _store("v", rows.inverse_root, n) + _store("m", rows.decay, triangle(n))


def _exponential_source(n: int) -> list[str]:
    """F = exp(M) - I by the degree-12 Taylor polynomial in Paterson-Stockmeyer form (M in `decay`, which becomes F)."""
    rows, size = layout(n), triangle(n)
    coefficient = [0.0] + [1.0 / float(np.prod(np.arange(1.0, k + 1))) for k in range(1, TAYLOR_DEGREE + 1)]
    lines = _load("m", rows.decay, size)
    lines += _product("p", "m", "m", n) + _product("q", "m", "p", n) + _product("f", "p", "p", n)

    def polynomial(first: int, i: int, j: int) -> str:
        t = packed(i, j)
        c = coefficient[first : first + 4]
        constant = f" + {c[0]!r}" if i == j and c[0] else ""
        return f"{c[1]!r} * m{t} + {c[2]!r} * p{t} + {c[3]!r} * q{t}{constant}"

    pairs = [(i, j) for i in range(n) for j in range(i + 1)]
    lines += [f"h{packed(i, j)} = {coefficient[12]!r} * f{packed(i, j)} + {polynomial(8, i, j)}" for i, j in pairs]
    for first in (4, 0):
        lines += _product("k", "h", "f", n)
        lines += [f"h{packed(i, j)} = k{packed(i, j)} + ({polynomial(first, i, j)})" for i, j in pairs]
    return lines + _store("h", rows.decay, size)


def _square_source(n: int) -> list[str]:
    """F <- 2 F + F^2, which is exp(2 M) - I.

    Next to the identity slow modes would lose the digits that squaring then magnifies.
    """
    rows, size = layout(n), triangle(n)
    lines = _load("f", rows.decay, size) + _product("k", "f", "f", n)
    lines += [f"k{t} = 2.0 * f{t} + k{t}" for t in range(size)]
    return lines + _store("k", rows.decay, size)


def _propagate_source(n: int) -> list[str]:
    """x' = x_ss + A_d (x - x_ss), P' = A_d P A_d^T + diag(noise), with A_d = C^(-1/2) (I + F) C^(1/2)."""
    rows, size = layout(n), triangle(n)
    lines = _load("e", rows.decay, size) + _load("r", rows.root, n) + _load("v", rows.inverse_root, n)
    lines += _load("x", rows.steady, n) + _load("m", rows.mean, n)
    lines += [f"e{packed(i, i)} = e{packed(i, i)} + 1.0" for i in range(n)]
    lines += [f"o{i} = (m{i} - x{i}) * r{i}" for i in range(n)]
    for i in range(n):
        total = " + ".join(f"e{packed(i, k)} * o{k}" for k in range(n))
        lines.append(f"{_at(rows.mean + i)} = x{i} + v{i} * ({total})")
    for i in range(n):
        for j in range(i + 1):
            t = packed(i, j)
            lines.append(f"p{t} = {_at(rows.covariance + t)} * r{i} * r{j}")
    for i in range(n):
        # Row i of A_d P, then row i of the result: a full matrix is never held at once.
        for j in range(n):
            lines.append(f"t{j} = " + " + ".join(f"e{packed(i, k)} * p{packed(k, j)}" for k in range(n)))
        for j in range(i + 1):
            total = " + ".join(f"t{k} * e{packed(k, j)}" for k in range(n))
            noise = f" + {_at(rows.noise + i)}" if i == j else ""
            lines.append(f"{_at(rows.covariance + packed(i, j))} = ({total}) * v{i} * v{j}{noise}")
    return lines


def _rejuvenate_source(d: int) -> Callable[..., None]:
    once = [f"c{i} = centre[{i}]" for i in range(d)]
    once += [f"j{packed(i, k)} = jitter[{i}, {k}]" for i in range(d) for k in range(i + 1)]
    lines = _load("z", d, d)
    for i in range(d):
        jittered = "".join(f" + j{packed(i, k)} * z{k}" for k in range(i + 1))
        lines.append(f"{_at(i)} = shrink * {_at(i)} + c{i}{jittered}")
    return _function("rejuvenate(size, s, shrink, centre, jitter)", lines, once)


def steady_state(size: tuple[int, ...], s: Any) -> None:
    """Row `steady` from `conductance` and `flow`."""
    _function("steady_state(size, s)", _steady_state_source(len(size)))(size, s)


def scale(size: tuple[int, ...], s: Any) -> None:
    """Rows `root`, `inverse_root`, `decay` and `norm` from `conductance` and the capacitances in `root`."""
    _function("scale(size, s)", _scale_source(len(size)))(size, s)


def exponential(size: tuple[int, ...], s: Any) -> None:
    """Row `decay` from M to exp(M) - I, for a small M."""
    _function("exponential(size, s)", _exponential_source(len(size)))(size, s)


def square(size: tuple[int, ...], s: Any) -> None:
    """Row `decay` from exp(M) - I to exp(2 M) - I."""
    _function("square(size, s)", _square_source(len(size)))(size, s)


def propagate(size: tuple[int, ...], s: Any) -> None:
    """Rows `mean` and `covariance` one step on."""
    _function("propagate(size, s)", _propagate_source(len(size)))(size, s)


def rejuvenate(size: tuple[int, ...], s: Any, shrink: float, centre: Any, jitter: Any) -> None:
    """Rows 0..d-1, parameter coordinates, to shrink * row + centre + jitter @ normals, which are rows d..2d-1."""
    _rejuvenate_source(len(size))(size, s, shrink, centre, jitter)


@overload(rejuvenate, jit_options=JIT)
def _rejuvenate(size, s, shrink, centre, jitter):  # type: ignore[no-untyped-def]
    return _rejuvenate_source(size.count)


def _compile(operation: Callable[..., None], source: Callable[[int], list[str]]) -> None:
    """In a kernel `operation` is the code that `source` writes for the type of its tuple."""

    @overload(operation, jit_options=JIT)
    def written_out(size, s):  # type: ignore[no-untyped-def]  # numba compares the bare signatures
        return _function(f"{operation.__name__}(size, s)", source(size.count))


_compile(steady_state, _steady_state_source)
_compile(scale, _scale_source)
_compile(exponential, _exponential_source)
_compile(square, _square_source)
_compile(propagate, _propagate_source)
