"""The volatility-based learning gate (paper 3.4.4)."""

from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.particle.options import VolatilityOptions


class Gate(NamedTuple):
    """`cdf` F_k and `gate` g_k, and the histogram (n_bins,) with the new median counted."""

    histogram: Array
    cdf: float
    gate: float


def weighted_quantiles(values: Array, weights: Array, levels: Array) -> Array:
    """Smallest of `values` (N,) at which the cumulated `weights` (N,) reach each of `levels` (L,) of their sum."""
    order = values.argsort()
    cumulated = weights[order].cumsum()
    index = cumulated.searchsorted(levels * cumulated[-1])
    return values[order[np.minimum(index, len(values) - 1)]]


def learning_gate(histogram: Array, log_median: float, options: VolatilityOptions) -> Gate:
    """Count log of the median volatility in the running histogram, read F_k off it and map it to g_k."""
    low, high = np.log(options.alpha_min), np.log(options.alpha_max)
    bins = len(histogram)
    index = min(int((log_median - low) / (high - low) * bins), bins - 1)
    counted = histogram.copy()
    counted[index] += 1.0
    cdf = float(counted[: index + 1].sum() / counted.sum())
    ramp = (options.gate_high - cdf) / (options.gate_high - options.gate_low)
    gate = options.gate_min + (1.0 - options.gate_min) * min(max(ramp, 0.0), 1.0)
    return Gate(counted, cdf, gate)


def learning_gates(histogram: Array, log_medians: Array, options: VolatilityOptions) -> list[Gate]:
    """The gate of each volatility block, from its row of `histogram` (B, n_bins) and its median (B,)."""
    return [learning_gate(counts, median, options) for counts, median in zip(histogram, log_medians, strict=True)]


def regime(cdf: float, options: VolatilityOptions) -> str:
    """The regime that F_k stands for: "low", "transitional" or "high" volatility."""
    if cdf <= options.gate_low:
        return "low"
    return "high" if cdf >= options.gate_high else "transitional"
