"""Hidden temperatures that follow a measurement."""

from __future__ import annotations

import numpy as np

from estimator.network import presets
from replay.experiments.series.following import follow, frozen, simulate
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
    window = [Window(0, 600)]
    truth = simulate(NETWORK, PERIOD, columns | {"T_i": np.zeros(600)}, window, THETA, START[None])
    wrong = START + np.array([0.0, 0.0, 8.0])
    drifted = follow(NETWORK, PERIOD, columns | {"T_i": truth[:, 0]}, window, THETA, wrong[None])
    np.testing.assert_array_equal(drifted[:, 0], truth[:, 0])
    assert np.abs(drifted[300:, 2] - truth[300:, 2]).max() < 0.25  # holding over a step leaves a little
    assert np.abs(drifted[300:, 1] - truth[300:, 1]).max() < 0.25


def test_where_nothing_was_measured_the_simulation_stands_in_and_gaps_stay_empty() -> None:
    columns = inputs()
    windows = [Window(0, 200), Window(300, 600)]
    free = simulate(NETWORK, PERIOD, columns, windows, THETA, np.array([START, START]))
    assert np.isnan(free[200:300]).all()
    followed = follow(
        NETWORK, PERIOD, columns | {"T_i": np.full(600, np.nan)}, windows, THETA, np.array([START, START])
    )
    np.testing.assert_array_equal(followed[:, 0], free[:, 0])
    assert np.isfinite(followed[:200]).all()


def test_a_network_without_hidden_nodes_is_its_measurement() -> None:
    network = frozen(NETWORK, THETA)
    assert not network.free
    measured = {node: np.full(600, 21.0) for node in NETWORK.nodes}
    everything = NETWORK.__class__(**{**vars(NETWORK), "measured": NETWORK.nodes})
    states = follow(everything, PERIOD, inputs() | measured, [Window(0, 600)], THETA, START[None])
    assert (states == 21.0).all()
