"""Hidden temperatures that follow a measurement."""

import numpy as np

from estimator.network import presets
from replay.experiments.series.following import follow
from replay.simulated.simulate import simulate

PERIOD = 300.0
NETWORK = presets.network("titethria")
THETA = np.array([parameter.nominal for parameter in NETWORK.parameters])
START = np.array([20.0, 17.0, 22.0])


ROWS = np.column_stack([5.0 + 5.0 * np.sin(np.arange(600) / 40), 1500.0 * (np.arange(600) % 50 < 20)])


def test_a_perfect_measurement_leads_to_the_true_hidden_nodes() -> None:
    truth = simulate(NETWORK, {}, ROWS, PERIOD, x0=START)
    followed = follow(NETWORK, THETA, PERIOD, truth[:, :1], ROWS)
    assert np.abs(followed[0] - START).max() > 1.0, "hidden nodes start elsewhere"
    assert np.abs(followed[300:] - truth[300:]).max() < 0.25


def test_where_nothing_was_measured_the_simulation_goes_on() -> None:
    outputs = np.full((600, 1), np.nan)
    outputs[0] = 20.0
    followed = follow(NETWORK, THETA, PERIOD, outputs, ROWS)
    np.testing.assert_allclose(followed, simulate(NETWORK, {}, ROWS, PERIOD, x0=followed[0]), atol=1e-9)
