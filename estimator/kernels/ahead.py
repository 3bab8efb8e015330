"""Many steps of the Kalman prediction without a measurement between them, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from estimator.kernels.lanes import JIT
from estimator.kernels.propagate import propagate
from estimator.kernels.steps import walk


@njit(cache=True, **JIT)
def outputs_ahead(  # type: ignore[no-untyped-def]
    size, capacitance, edges, heat, heat_gain,
    lower, upper, logit, free, fixed,
    period, plan, coordinates, mean, covariance, log_alpha, block, process_variance,
    seed, origin, stream, walk_sd, jump_probability, jump_sd, lowest, highest,
    nodes, out_means, out_variances,
):  # fmt: skip
    """Means and variances (h, n_y, N) of the states `nodes` after each row of `plan` (h, n_u), from step `origin` on.

    The other arguments are those of `propagate` and `walk`.
    """
    alpha, moved_alpha = log_alpha.copy(), np.empty_like(log_alpha)
    now, moved = mean.copy(), np.empty_like(mean)
    spread, moved_spread = covariance.copy(), np.empty_like(covariance)
    for ahead in range(plan.shape[0]):
        step = origin + np.uint64(ahead + 1)
        walk(seed, step, stream, walk_sd, jump_probability, jump_sd, lowest, highest, alpha, moved_alpha)
        propagate(
            size, capacitance, edges, heat, heat_gain, lower, upper, logit, free, fixed,
            period, plan[ahead], coordinates, now, spread, moved_alpha, block, process_variance, moved, moved_spread,
        )  # fmt: skip
        alpha, moved_alpha = moved_alpha, alpha
        now, moved = moved, now
        spread, moved_spread = moved_spread, spread
        for y in range(nodes.shape[0]):
            node = nodes[y]
            out_means[ahead, y] = now[node]
            out_variances[ahead, y] = spread[node * (node + 1) // 2 + node]
