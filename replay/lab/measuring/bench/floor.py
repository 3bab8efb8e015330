"""The least that one update costs: operations and bytes, counted from the method, over what the machine can do.

Counted per particle for n states and d free parameters, a multiplication and an addition being two operations; an
exponential, logarithm, root or division counts as the polynomial or the Newton steps that vector code takes for it.
Bytes are those of the state read and written once; what is kept in between could stay in the caches.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from estimator.arrays import Array
from estimator.network.assembly import assemble
from estimator.network.space import parameter_space
from estimator.particle.rbpf import RBPF

_EXPONENTIAL = 27
"""Range reduction and a polynomial of degree 10."""
_LOGARITHM = 28
_DIVISION = 8
_ROOT = 10
_NORMAL = 90
"""A standard normal deviate: its share of ten Philox rounds and of a logarithm, root, sine and cosine."""
_NORMAL_TAIL = 2 * 15 + _DIVISION + 10
_TAYLOR_PRODUCTS = 5
"""Matrix products in a degree-12 Taylor polynomial after Paterson and Stockmeyer."""
_TAYLOR_NORM = 0.35
"""Norm up to which that polynomial is exact to rounding; beyond it the exponential is squared."""
_BLOCK = 1
"""Particles that are squared together."""
_HALLEY_STEPS = 2
_LEVELS = 3


def floors(estimator: RBPF, state: Any, measured: Mapping[str, float]) -> dict[str, Any]:
    """Operations by stage, bytes, and the time of each at the `measured` peak, in s for one update."""
    particles, n, d = state.mean.shape[1], state.mean.shape[0], state.coordinates.shape[0]
    squarings = mean_squarings(estimator, state)
    by_stage = operations(n, d, len(estimator.network.conductances), squarings)
    total = particles * sum(by_stage.values())
    arrays = (state.coordinates, state.log_alpha, state.mean, state.covariance, state.log_weights)
    moved = 2 * sum(array.nbytes for array in arrays)
    return {
        "squarings": squarings,
        "operations_per_particle": by_stage,
        "operations": total,
        "bytes": moved,
        "operations_s": total / measured["flops_per_s"],
        "bytes_s": moved / measured["bytes_per_s"],
        "stages_s": {name: particles * count / measured["flops_per_s"] for name, count in by_stage.items()},
    }


def operations(n: int, d: int, edges: int, squarings: float) -> dict[str, float]:
    """Operations per particle of every stage, for n states, d free parameters, so many conductances and squarings."""
    triangle = n * (n + 1) // 2
    # One product of commuting symmetric matrices: only its triangle is computed.
    product = 2.0 * n * triangle
    return {
        "volatility": _NORMAL + _EXPONENTIAL + 6.0,
        "parameters": d * (2.0 * _EXPONENTIAL + _DIVISION + 3.0),
        "assembly": 3.0 * edges + 2.0 * edges,
        "steady state": n**3 / 3.0 + 2.0 * n**2 + n * _DIVISION,
        "scaling": n * (_ROOT + _DIVISION) + 2.0 * triangle + n**2,
        "exponential": _TAYLOR_PRODUCTS * product + 12.0 * triangle,
        "squarings": squarings * (product + triangle),
        "Kalman prediction": 2.0 * n**2 + 2.0 * n * n**2 + product + 4.0 * triangle + 2.0 * n,
        "quantiles": _LEVELS * _HALLEY_STEPS * (_EXPONENTIAL + _NORMAL_TAIL + 8.0),
        "assimilation": _DIVISION + _LOGARITHM + 4.0 * n + 2.0 * triangle + 6.0,
        "weights": _EXPONENTIAL + 4.0,
        "volatility quantiles": 6.0,
        "parameter mean": d * (_EXPONENTIAL + _DIVISION + 2.0),
        "moments": 2.0 * d + d + d * (d + 1.0),
        "normals": float(d * _NORMAL),
        "rejuvenation": 2.0 * d + d * (d + 1.0),
    }


def mean_squarings(estimator: RBPF, state: Any) -> float:
    """How often the exponential is squared, on average over blocks of particles."""
    options = estimator.options
    space = parameter_space(estimator.network, logit=options.coordinates == "logit")
    matrices = assemble(estimator.network, space.parameters(state.coordinates))
    roots = np.sqrt(matrices.capacitance)
    rates = matrices.internal / (roots[:, :, None] * roots[:, None, :])
    norms: Array = np.abs(rates).sum(axis=2).max(axis=1) * estimator.period
    blocks = [norms[first : first + _BLOCK].max() for first in range(0, len(norms), _BLOCK)]
    return float(np.mean(np.maximum(np.ceil(np.log2(np.array(blocks) / _TAYLOR_NORM)), 0.0)))
