"""The stochastic-volatility state (paper 3.4.1)."""

from __future__ import annotations

import numpy as np

from estimator.arrays import Array
from estimator.kernels.draws import Draws, Purpose
from estimator.particle.options import Options


def propagate_volatility(log_alpha: Array, options: Options, draws: Draws) -> Array:
    """log alpha (B, N) one step on: the log-random walk (21), clipped, with rare jumps if `jump_probability` > 0.

    The walk alone reacts a few samples late at the start of an event; the jump component is ours, not the paper's.
    """
    # Every block has four rows of draws: steps, sizes of jumps, whether to jump, and one that is not used.
    shape = 4 * log_alpha.shape[0], log_alpha.shape[1]
    normals, uniforms = draws.normals(Purpose.WALK, shape), draws.uniforms(Purpose.WALK, shape)
    walked = log_alpha + options.volatility_sd * normals[0::4]
    walked = np.where(uniforms[2::4] < options.jump_probability, walked + options.jump_sd * normals[1::4], walked)
    return np.clip(walked, np.log(options.alpha_min), np.log(options.alpha_max))
