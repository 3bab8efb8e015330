"""What structure an open-loop residual still has (paper 4.3.3). Small values: little is left to explain."""

import numpy as np

from estimator.arrays import Array


def residual_autocorrelation(residual: Array, lags: int, first: int = 1) -> float:
    """J_acf (40): sum of the squared autocorrelations of `residual` (K,), NaN where missing, at lags `first` to `lags`
    (the paper does not say from which). They are normalised with the variance of the whole series, over the pairs that
    are complete. NaN for a constant residual or one without lags."""
    e = residual - np.nanmean(residual)
    variance, known = np.nanmean(e**2), np.count_nonzero(~np.isnan(e))
    if not variance > 0.0 or len(e) <= lags:
        return float("nan")
    total = 0.0
    for lag in range(first, lags + 1):
        products = e[lag:] * e[: len(e) - lag]
        complete = products[~np.isnan(products)]
        if complete.size:
            # Over all rows, not over the pairs of this lag: the biased estimate, whose correlations stay within 1.
            total += float(complete.sum() / known / variance) ** 2
    return total
