"""Hidden temperatures that follow a measurement."""

from __future__ import annotations

import numpy as np

from estimator.network import presets
from replay.experiments.series.following import follow, simulate
from replay.scores.windows import Window

PERIOD = 300.0
NETWORK = presets.network("titethria")
THETA = np.array([parameter.nominal for parameter in NETWORK.parameters])
START = np.array([20.0, 17.0, 22.0])


def inputs(steps: int = 600) -> dict[str, np.ndarray]:
    k = np.arange(steps)
    return {"T_out": 5.0 + 5.0 * np.sin(k / 40), "u_heat": 1500.0 * (k % 50 < 20)}


def test_a_perfect_measurement_leads_to_the_true_hidden_nodes() -> None:
    columns = inputs()
    rows = np.column_stack([columns["T_out"], columns["u_heat"]])
    truth = simulate(NETWORK, PERIOD, columns, [Window(0, 600)], THETA, START[None])
    followed = follow(NETWORK, THETA, PERIOD, truth[:, :1], rows)
    assert np.abs(followed[0] - START).max() > 1.0, "hidden nodes start elsewhere"
    assert np.abs(followed[300:] - truth[300:]).max() < 0.25


def test_where_nothing_was_measured_the_simulation_goes_on() -> None:
    columns = inputs()
    rows = np.column_stack([columns["T_out"], columns["u_heat"]])
    outputs = np.full((600, 1), np.nan)
    outputs[0] = 20.0
    followed = follow(NETWORK, THETA, PERIOD, outputs, rows)
    free = simulate(NETWORK, PERIOD, columns, [Window(0, 600)], THETA, followed[:1])
    np.testing.assert_allclose(followed, free, atol=1e-9)
