"""The data of one seed of the semi-synthetic building, as the estimators take it, and the truth behind it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.network.network import Network
from replay.experiments.request import Request
from replay.experiments.series.filtering import Series
from replay.simulated.semi_synthetic import Truth, generate

HELD = ("C_i", "C_h", "C_s", "g_is")
"""Parameters of building 67 that the authors' runs hold at the truth."""


class Case(NamedTuple):
    """The data of one seed."""

    series: Series
    truth: Truth


def simulated_case(network: Network, request: Request, seed: int) -> Case:
    """`network` simulated over the weather of `request`; ReplayError where that cannot be."""
    recording = generate(request.file, days=request.days, seed=seed, network=network)
    starts = np.zeros(len(recording.times), dtype=np.bool_)
    starts[0] = True
    outputs, inputs = (
        np.column_stack([recording.columns[name] for name in names]) for names in (network.measured, network.inputs)
    )
    return Case(Series(recording.times, outputs, inputs, starts), recording.truth)
