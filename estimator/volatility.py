"""The stochastic-volatility state (paper 3.4.1)."""

from __future__ import annotations

import numpy as np

from estimator.draws import Draws, Purpose
from estimator.options import Options
from estimator.types import Array


def propagate_volatility(log_alpha: Array, options: Options, draws: Draws) -> Array:
    """log alpha (B, N) one step on: the log-random walk (21), clipped, with rare jumps if `jump_probability` > 0.

    The walk alone reacts a few samples late at the start of an event; the jump component is ours, not the paper's.
    """
    walked = log_alpha + options.volatility_sd * draws.normals(Purpose.WALK, log_alpha.shape)
    if options.jump_probability > 0:
        jumps = draws.uniforms(Purpose.JUMP, log_alpha.shape) < options.jump_probability
        walked[jumps] += options.jump_sd * draws.normals(Purpose.JUMP_SIZE, (int(jumps.sum()),))
    return np.clip(walked, np.log(options.alpha_min), np.log(options.alpha_max))
