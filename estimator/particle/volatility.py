"""The stochastic-volatility state (paper 3.4.1)."""

import numpy as np

from estimator.arrays import Array
from estimator.kernels.draws import Draws, Purpose
from estimator.particle.options import VolatilityOptions


def propagate_volatility(log_alpha: Array, options: VolatilityOptions, draws: Draws) -> Array:
    """log alpha (B, N) one step on: the log-random walk (21), clipped, with rare jumps if `jump_probability` > 0.

    The walk alone reacts a few samples late at the start of an event; the jump component is ours, not the paper's.
    """
    # Every block has four rows of draws: steps, sizes of jumps, whether to jump, and one that is not used.
    blocks, particles = log_alpha.shape
    normals = draws.normals(Purpose.WALK, (4 * blocks - 2, particles))
    uniforms = draws.uniforms(Purpose.WALK, (4 * blocks - 1, particles))
    return walked_volatility(log_alpha, normals[0::4], normals[1::4], uniforms[2::4], options)


def walked_volatility(log_alpha: Array, steps: Array, jumps: Array, places: Array, options: VolatilityOptions) -> Array:
    """`propagate_volatility` by given standard normal `steps` and `jumps` and uniform `places`, all (B, N)."""
    walked = log_alpha + options.volatility_sd * steps
    walked = np.where(places < options.jump_probability, walked + options.jump_sd * jumps, walked)
    return np.clip(walked, np.log(options.alpha_min), np.log(options.alpha_max))
