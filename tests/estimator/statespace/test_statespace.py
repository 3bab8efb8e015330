"""The matrices that an estimator's state stands for: simulated, they give the mean of its own fan."""

import numpy as np
import pytest
from support.forecasts import mean_path, unfolded

from estimator.network.presets import network
from estimator.registry import build
from estimator.statespace.matrices import of_draws, of_point
from estimator.statespace.simulate import Simulation, coupled_paths, sampled_paths

PERIOD = 300.0
SMALL = {
    "rbpf": {"particles": 300},
    "ekf": {},
    "ukf": {},
    "mkf": {"particles": 60, "scenarios": 400},
    "bank": {"members": {"jump": {"estimator": "mkf", "particles": 40, "scenarios": 400}, "arx": {"estimator": "arx"}}},
}


def learned(name, preset="titeth", steps=60, options=None):
    """An estimator and its state after some hours of heating and cooling."""
    estimator = build(name, network(preset), PERIOD, SMALL[name] if options is None else options)
    rng = np.random.default_rng(3)
    u = np.array([5.0, 0.0])
    state = estimator.start(1, np.array([20.0]), u)
    for k in range(steps):
        u = np.array([5.0, 1500.0 * (k % 12 < 6)])
        state = estimator.predict(state, u)
        state = estimator.update(state, np.array([20 + np.sin(k / 8) + 0.05 * rng.standard_normal()])).state
    return estimator, estimator.predict(state, u)


def plan_of(steps):
    return np.column_stack([np.linspace(5.0, 0.0, steps), 1500.0 * (np.arange(steps) % 24 < 12)])


def fan_of(estimator, state, plan):
    mixtures = unfolded(estimator, state, plan)
    return np.array([m.mean() for m in mixtures]), np.array([m.sd() for m in mixtures])


@pytest.mark.parametrize(("name", "count"), [("ekf", 10), ("rbpf", 300), ("rbpf", 100), ("ukf", 400), ("mkf", 400)])
def test_matrices_give_the_mean_of_the_fan(name, count):
    """The point of an EKF and all particles of the other exactly, draws within their sampling error."""
    estimator, state = learned(name)
    draws, plan = estimator.draws(state, count), plan_of(48)
    assert draws.point_is_fan == (name == "ekf")
    path = mean_path((of_point if draws.point_is_fan else of_draws)(draws, PERIOD, 1), plan)
    mean, sd = fan_of(estimator, state, plan)
    exact = count in (10, SMALL["rbpf"]["particles"])
    assert (np.abs(path - mean) <= (1e-8 if exact else 5.0 * sd / np.sqrt(count))).all()


def test_a_bank_gives_the_model_of_its_best_physical_member():
    estimator, state = learned("bank")
    draws, plan = estimator.draws(state, 400), plan_of(24)
    assert draws.member == "jump"
    assert 0.0 < draws.share <= 1.0
    member = estimator.members[0]
    path = mean_path(of_draws(draws, PERIOD, 1), plan)
    mean, sd = fan_of(member, state.members[0], plan)
    assert (np.abs(path - mean) <= 5.0 * sd / np.sqrt(400)).all()


@pytest.mark.parametrize("name", ["rbpf", "ekf", "mkf"])
def test_a_longer_step_passes_through_the_values_of_the_shorter_one(name):
    estimator, state = learned(name)
    draws = estimator.draws(state, 50)
    short, long = of_draws(draws, PERIOD, 1), of_draws(draws, PERIOD, 6)
    coarse = np.array([[5.0, 1500.0], [4.0, 0.0], [3.0, 700.0]])
    assert np.allclose(mean_path(long, coarse), mean_path(short, np.repeat(coarse, 6, axis=0))[::6], rtol=1e-10)
    # Noise over six periods is what six independent ones leave.
    transition = short.a
    spread = np.zeros_like(short.q)
    for _ in range(6):
        spread = transition @ spread @ transition.transpose(0, 2, 1) + short.q
    assert np.allclose(long.q, spread, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("name", ["rbpf", "ekf", "ukf", "mkf"])
def test_mean_and_covariance_are_those_of_the_forecast(name):
    estimator, state = learned(name)
    draws, standing = estimator.draws(state, 200), estimator.predictive(state)
    assert draws.mean[0] == pytest.approx(standing.mean()[0], abs=1e-9)
    noise = (draws.weights * draws.measurement_variance[0]).sum()
    assert draws.covariance[0, 0] + noise == pytest.approx(standing.sd()[0] ** 2, rel=0.25 if name == "mkf" else 1e-6)
    assert np.linalg.eigvalsh(draws.covariance).min() > -1e-9 * draws.covariance.max()


def test_an_mkf_knows_the_gain_in_watts():
    estimator, state = learned("mkf")
    models = of_draws(estimator.draws(state, 100), PERIOD, 3)
    assert models.a.shape == (100, 4, 4)
    assert models.state.shape == (100, 4)
    # Some of it is left after a step, it warms the room, and nothing measured heats it.
    assert ((models.a[:, 3, 3] > 0.0) & (models.a[:, 3, 3] < 1.0)).all()
    assert (models.a[:, 0, 3] > 0.0).all()
    assert not models.a[:, 3, :3].any()
    assert not models.b[:, 3].any()


@pytest.mark.parametrize("name", ["rbpf", "ekf", "mkf"])
def test_sampled_futures_spread_as_the_fan_does_and_repeat(name):
    estimator, state = learned(name)
    draws, plan = estimator.draws(state, 300), plan_of(24)
    first, again = (sampled_paths(draws, PERIOD, plan, 5, 60) for _ in range(2))
    assert first.tobytes() == again.tobytes()
    assert first.shape == (300, 25, 1)
    mean, sd = fan_of(estimator, state, plan)
    assert (np.abs(first.mean(axis=0) - mean) <= 6.0 * sd / np.sqrt(300)).all()
    # In the fan of an MKF gains begin. Volatility stays along a path, the fan has the noise of the sensor, and an EKF
    # is linear.
    if name != "mkf":
        assert 0.5 < first[:, -1, 0].std() / sd[-1, 0] < 2.0
    assert not np.array_equal(first, sampled_paths(draws, PERIOD, plan, 6, 60))


def test_a_gain_that_ends_with_every_step_leaves_the_futures_alone():
    estimator, state = learned("mkf", options={"particles": 40, "gain_off_probability": 1.0})
    assert np.isfinite(sampled_paths(estimator.draws(state, 100), PERIOD, plan_of(6), 5, 60)).all()


def test_rooms_that_share_a_wall_are_simulated_together():
    """Two equal rooms, one warm and one cold, each other's neighbour: they come closer, and equal rooms stay equal."""
    net = network("ecolar-6r4c")
    estimator = build("ekf", net, PERIOD, {})
    at = net.inputs.index("T_adj")
    warm, cold = (estimator.start(1, np.array([t]), np.array([5.0, t, 0.0])) for t in (24.0, 16.0))
    plan = np.tile(np.array([20.0, 20.0, 0.0]), (288, 1))

    def model(state):
        return of_point(estimator.draws(state, 2), PERIOD, 1)

    alone = [mean_path(model(state), plan) for state in (warm, cold)]
    rooms = [Simulation(model(state)) for state in (warm, cold)]
    plans = coupled_paths(rooms, [plan, plan], [{at: (1, 0)}, {at: (0, 0)}])
    together = [mean_path(model(state), own) for state, own in zip((warm, cold), plans, strict=True)]
    # What one room is told of the other is what the other then does.
    assert np.allclose(plans[0][:, at], together[1][:-1, 0], atol=1e-9)
    assert np.allclose(plans[1][:, at], together[0][:-1, 0], atol=1e-9)
    assert together[0][100, 0] != pytest.approx(alone[0][100, 0], abs=1e-3)
    assert together[0][-1, 0] - together[1][-1, 0] < 8.0
