"""The matrix algebra of a zone's step, written out element by element for a network of n states.

The matrices of a zone are tiny: a product without loops, loads and stores is ten times faster than loops over i, j
and k. Every function here is plain arithmetic on lists of entries. The entries may be numbers, arrays over particles
or `lanes.Value`s: with numbers it computes, with Values it writes the code of a kernel.

Symmetric matrices are packed lower triangles: n (n + 1) / 2 entries, row by row.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import factorial
from typing import Any

import numpy as np

TAYLOR_DEGREE = 12
SMALL_NORM = 0.35
"""Norm below which the degree-12 polynomial of exp(M) - 1 is exact to rounding: .35^12 / 13! = 5e-16."""

Entries = Sequence[Any]


def triangle(n: int) -> int:
    """Entries of a packed n x n triangle."""
    return n * (n + 1) // 2


def packed(i: int, j: int) -> int:
    """Place of (i, j) in a packed triangle."""
    return i * (i + 1) // 2 + j if i >= j else j * (j + 1) // 2 + i


def _pairs(n: int) -> list[tuple[int, int]]:
    return [(i, j) for i in range(n) for j in range(i + 1)]


def _root(x: Any) -> Any:
    return x.sqrt() if hasattr(x, "sqrt") else np.sqrt(x)


def _larger(x: Any, y: Any) -> Any:
    return x.maximum(y) if hasattr(x, "maximum") else np.maximum(x, y)


def _total(terms: Sequence[Any]) -> Any:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def _product(left: Entries, right: Entries, n: int) -> list[Any]:
    """left @ right for commuting symmetric matrices."""
    return [_total([left[packed(i, k)] * right[packed(k, j)] for k in range(n)]) for i, j in _pairs(n)]


def steady_state(conductance: Entries, flow: Entries, n: int) -> list[Any]:
    """x_ss (n) of G x_ss = B u, by an LDL^T factorisation."""
    g, x = list(conductance), list(flow)
    factor: dict[tuple[int, int], Any] = {}
    inverse: list[Any] = []
    for j in range(n):
        for k in range(j):
            g[packed(j, j)] = g[packed(j, j)] - factor[j, k] * g[packed(j, k)]
        inverse.append(1.0 / g[packed(j, j)])
        for i in range(j + 1, n):
            for k in range(j):
                g[packed(i, j)] = g[packed(i, j)] - factor[j, k] * g[packed(i, k)]
            factor[i, j] = g[packed(i, j)] * inverse[j]
    for i in range(n):
        for k in range(i):
            x[i] = x[i] - factor[i, k] * x[k]
    x = [x[i] * inverse[i] for i in range(n)]
    for i in reversed(range(n)):
        for k in range(i + 1, n):
            x[i] = x[i] - factor[k, i] * x[k]
    return x


def roots(capacitance: Entries) -> tuple[list[Any], list[Any]]:
    """C^(1/2) and C^(-1/2), each (n)."""
    root = [_root(entry) for entry in capacitance]
    return root, [1.0 / entry for entry in root]


def scaled_rate(conductance: Entries, inverse: Entries, n: int) -> list[Any]:
    """C^(-1/2) G C^(-1/2) from C^(-1/2)."""
    return [conductance[packed(i, j)] * (inverse[i] * inverse[j]) for i, j in _pairs(n)]


def norm(matrix: Entries, n: int) -> Any:
    """The largest sum of absolute values of a row."""
    magnitude = [abs(entry) for entry in matrix]
    largest = _total([magnitude[packed(0, j)] for j in range(n)])
    for i in range(1, n):
        largest = _larger(largest, _total([magnitude[packed(i, j)] for j in range(n)]))
    return largest


def exponential(matrix: Entries, n: int) -> list[Any]:
    """exp(M) - I of a small M by the degree-12 Taylor polynomial in Paterson-Stockmeyer form."""
    coefficient = [1.0 / factorial(k) for k in range(TAYLOR_DEGREE + 1)]
    square = squared(matrix, n)
    cube = _product(matrix, square, n)
    fourth = squared(square, n)

    def cubic(first: int, i: int, j: int) -> Any:
        t = packed(i, j)
        value = (
            matrix[t] * coefficient[first + 1] + square[t] * coefficient[first + 2] + cube[t] * coefficient[first + 3]
        )
        return value + coefficient[first] if i == j and first else value

    power = [fourth[packed(i, j)] * coefficient[12] + cubic(8, i, j) for i, j in _pairs(n)]
    for first in (4, 0):
        product = _product(power, fourth, n)
        power = [product[packed(i, j)] + cubic(first, i, j) for i, j in _pairs(n)]
    return power


def doubled(matrix: Entries, n: int) -> list[Any]:
    """exp(2 M) - I = 2 F + F^2 from F = exp(M) - I.

    Next to the identity slow modes would lose the digits that squaring then magnifies. Every square of an element is
    used twice, and f_ii f_ij + f_ij f_jj + 2 f_ij is one product.
    """
    shifted = [matrix[packed(i, i)] + 1.0 for i in range(n)]
    squared = {(i, j): matrix[packed(i, j)] * matrix[packed(i, j)] for i in range(n) for j in range(i)}
    result: list[Any] = []
    for i, j in _pairs(n):
        entry = matrix[packed(i, j)]
        if i == j:
            others = [squared[max(i, k), min(i, k)] for k in range(n) if k != i]
            result.append(_total([entry * (entry + 2.0), *others]))
        else:
            others = [matrix[packed(i, k)] * matrix[packed(k, j)] for k in range(n) if k not in (i, j)]
            result.append(_total([entry * (shifted[i] + shifted[j]), *others]))
    return result


def squared(matrix: Entries, n: int) -> list[Any]:
    """M^2 of a symmetric matrix."""
    square = {(i, j): matrix[packed(i, j)] * matrix[packed(i, j)] for i in range(n) for j in range(i)}
    result: list[Any] = []
    for i, j in _pairs(n):
        entry = matrix[packed(i, j)]
        if i == j:
            others = [square[max(i, k), min(i, k)] for k in range(n) if k != i]
            result.append(_total([entry * entry, *others]))
        else:
            others = [matrix[packed(i, k)] * matrix[packed(k, j)] for k in range(n) if k not in (i, j)]
            result.append(_total([entry * (matrix[packed(i, i)] + matrix[packed(j, j)]), *others]))
    return result


def transition(decay: Entries, root: Entries, inverse: Entries, n: int) -> list[list[Any]]:
    """A_d (n, n) = C^(-1/2) (I + F) C^(1/2) from F and the roots of the capacitances."""
    return [
        [decay[packed(i, i)] + 1.0 if i == j else decay[packed(i, j)] * (inverse[i] * root[j]) for j in range(n)]
        for i in range(n)
    ]


def predicted_mean(transition: Sequence[Entries], steady: Entries, mean: Entries, n: int) -> list[Any]:
    """x' = x_ss + A_d (x - x_ss)."""
    offset = [mean[i] - steady[i] for i in range(n)]
    return [_total([steady[i]] + [transition[i][k] * offset[k] for k in range(n)]) for i in range(n)]


def predicted_covariance(transition: Sequence[Entries], covariance: Entries, noise: Entries, n: int) -> list[Any]:
    """P' = A_d P A_d^T + diag(noise)."""
    result: list[Any] = []
    for i in range(n):
        row = [_total([transition[i][k] * covariance[packed(k, j)] for k in range(n)]) for j in range(n)]
        for j in range(i + 1):
            terms = [row[k] * transition[j][k] for k in range(n)]
            result.append(_total([noise[i], *terms] if i == j else terms))
    return result
