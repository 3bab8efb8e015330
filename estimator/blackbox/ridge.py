"""Ridge regressions from sums of products, and how far what they foretell is to be believed."""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def fitted(moments, least, penalty, prior):  # type: ignore[no-untyped-def]
    """Coefficients (n_y, L, p) of the ridge regressions, drawn to the `prior` (L, p) as by `penalty` samples."""
    outputs, leads, width = moments.shape[:3]
    found = np.zeros((outputs, leads, width))
    matrix, right = np.empty((width - 1, width - 1)), np.empty(width - 1)
    for i in range(outputs):
        for n in range(leads):
            whole = moments[i, n, 0, 0]
            if whole <= 0.0:
                found[i, n] = prior[n]
                continue
            means = moments[i, n, 0] / whole
            for a in range(1, width):
                for b in range(1, width):
                    matrix[a - 1, b - 1] = moments[i, n, a, b] / whole - means[a] * means[b]
                right[a - 1] = moments[i, n, a, width] / whole - means[a] * means[width]
            for a in range(1, width):
                drawn = max(matrix[a - 1, a - 1], least[a]) * penalty / whole
                matrix[a - 1, a - 1] += drawn
                right[a - 1] += drawn * prior[n, a]
            own = _solved(matrix, right)
            found[i, n, 1:] = own
            found[i, n, 0] = means[width] - np.sum(means[1:width] * own)
    return found


@njit(cache=True, nogil=True)
def _solved(matrix, right):  # type: ignore[no-untyped-def]
    """The solution (n,) of a positive definite system, by Cholesky factors in a fixed order of sums."""
    size = len(right)
    factor, found = np.zeros((size, size)), right.copy()
    for a in range(size):
        for b in range(a + 1):
            total = matrix[a, b]
            for c in range(b):
                total -= factor[a, c] * factor[b, c]
            factor[a, b] = np.sqrt(max(total, 1e-12)) if a == b else total / factor[b, b]
    for a in range(size):
        for c in range(a):
            found[a] -= factor[a, c] * found[c]
        found[a] /= factor[a, a]
    for a in range(size - 1, -1, -1):
        for c in range(a + 1, size):
            found[a] -= factor[c, a] * found[c]
        found[a] /= factor[a, a]
    return found


@njit(cache=True, nogil=True)
def trusts(verified, doubted, believed):  # type: ignore[no-untyped-def]
    """(n_y, L): shares of foretold changes that came true, beside `doubted` (L,) forecasts that foretold as much as
    changed, and of which the share `believed` (L,) did. Sums (n_y, L, 4) of what was `verified`: of the number, of
    the foretold change times the real one, and of the squares of both."""
    found = np.empty(verified.shape[:2])
    for i in range(verified.shape[0]):
        for n in range(verified.shape[1]):
            number, product, square, real = verified[i, n, 0], verified[i, n, 1], verified[i, n, 2], verified[i, n, 3]
            doubt = doubted[n] * real / max(number, 1.0)
            found[i, n] = min(max((product + believed[n] * doubt) / max(square + doubt, 1e-12), 0.0), 1.0)
    return found
