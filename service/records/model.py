"""The linear model of a zone that a controller plans with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.statespace.matrices import StateSpace
from service.records.update import Update

Array = npt.NDArray[np.float64]


class ZoneModel(NamedTuple):
    """What the estimator of a zone knows as state-space matrices, at a step of `step` s."""

    update: Update
    """The newest update: the state is the one predicted for the valid time of its forecast."""
    step: int
    member: str
    """The member of a bank that this is the model of; empty where there is no bank."""
    share: float
    """What that member weighs in the bank's forecast a few hours ahead, 0 to 1."""
    fan_is: str
    """Which of the two gives the mean of the fan: "mean" or "draws"."""
    mean: StateSpace
    """One model, at the posterior mean."""
    draws: StateSpace
    """K models."""
    covariance: Array
    """(n_x + G, n_x + G): posterior covariance of temperatures [K^2] and gain [W^2]."""
    known_heat: Array
    """(h, n_x + G): what sun and habits add to the states of `mean` over each step of a day [K], under inputs as they
    are foreseen without a plan; h is 0 where the network has no terms."""
    gain: Array
    """(2, h): mean and standard deviation of the unmeasured gain [W] at the beginning of each step of a day; h is 0
    where the estimator has none."""
