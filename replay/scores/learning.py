"""Whether an estimator learns from disturbances, and whether its volatility tells them (paper 3.5.2 and 5.1.2)."""

import numpy as np
from scipy.stats import rankdata

from estimator.arrays import Array
from replay.scores.intervals import Mask

EPSILON = 1e-12
"""The constant of (34): keeps the index finite when nothing is learned in low-disturbance periods."""


def update_magnitudes(theta: Array) -> Array:
    """d_k = ||log theta_k - log theta_(k-1)|| (33) of point estimates `theta` (K, n_theta): shape (K,), d_0 is NaN."""
    return np.concatenate([[np.nan], np.linalg.norm(np.diff(np.log(theta), axis=0), axis=1)])


def parasitic_learning_index(magnitudes: Array, dominated: Mask) -> float:
    """Median update in disturbance-dominated steps over the median in the others (34); both (K,). About 1: learning is
    indifferent to disturbances. NaN where one of the two regimes has no step."""
    known = ~np.isnan(magnitudes)
    during, otherwise = magnitudes[dominated & known], magnitudes[~dominated & known]
    if not during.size or not otherwise.size:
        return float("nan")
    return float(np.median(during) / (np.median(otherwise) + EPSILON))


def area_under_roc(score: Array, label: Mask) -> float:
    """Probability that `score` (K,) is higher where `label` (K,) holds than where not, ties half: the Mann-Whitney
    statistic over the product of the sizes. NaN where all labels agree; rows without a score do not count."""
    known = ~np.isnan(score)
    score, label = score[known], label[known]
    positive = int(label.sum())
    negative = len(label) - positive
    if not positive or not negative:
        return float("nan")
    above = rankdata(score)[label].sum() - positive * (positive + 1) / 2
    return float(above / (positive * negative))
