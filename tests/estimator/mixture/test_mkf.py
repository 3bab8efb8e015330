"""The mixture Kalman filter: against a textbook filter, finite differences, what it was simulated with, its oracle."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.special import ndtr
from support.forecasts import mean_path, unfolded
from support.small_building import PERIOD, TRUTH, after, building, known, record, textbook_kalman, two_rooms

from estimator.heat.known import KnownHeat, LocalTime
from estimator.heat.sun import Location
from estimator.heat.terms import with_known_heat
from estimator.kernels.packing import packed
from estimator.network.network import Gain, HeatInput, Parameter
from estimator.network.presets import network
from estimator.network.terms import HeatTerm
from estimator.particle.kalman import unpack
from estimator.registry import build
from estimator.statespace.matrices import of_draws
from replay.simulated.simulate import simulate

PRESETS = ("jump", "drift", "free", "steady", "output-error", "habits")


def with_terms(net, *nodes):
    """`net` with a habit [W] and an aperture [m2] of each of `nodes`, of which an aperture is never negative."""
    terms = [
        term
        for node in nodes
        for term in (
            HeatTerm(f"habit {node}", node, "habit", "W", 200.0, 80.0, walk=5.0),
            HeatTerm(f"sun {node}", node, "sun", "m2", 0.5, 2.0, walk=0.03, lower=0.0),
        )
    ]
    return replace(net, terms=tuple(terms)).validate()


# Kernels are compiled for each number of states, which takes half a minute: these have two, three and five.
NETWORKS = {name: network(name) for name in ("building-67", "m3", "titethria")} | {
    "two-rooms": two_rooms(),
    "solar": network("titethria").with_solar("T_i", Parameter("A_w", "m2", 0.1, 30.0)),
    "terms": with_terms(network("titethria"), "T_i", "T_e"),
    "terms-of-two-rooms": with_terms(two_rooms(), "T_a", "T_b"),
}


def inputs_of(net, rng):
    boundaries = len(net.boundaries)
    heat = rng.uniform(0, 2000, len(net.inputs) - boundaries)
    known = rng.uniform(0, 1, len(net.terms)) * np.array([800.0 if term.unit == "m2" else 1.0 for term in net.terms])
    return np.concatenate([5 + 3 * rng.standard_normal(boundaries), heat, known])


def assert_same(left, right, before):
    """Particles that agree to 1e-9; an element of a covariance by the standard deviations that it belongs to.

    They are those of `before` where these are larger: where a new gain of unknown size has just shown itself, an update
    leaves a small difference of large numbers.
    """
    for name, a, b in zip(left._fields, left, right, strict=True):
        if name == "covariance":
            full_a, full_b = unpack(a), unpack(b)
            sds = np.sqrt(np.maximum(*(np.einsum("nii->ni", unpack(c)) for c in (a, before.covariance)))) + 1e-300
            assert (np.abs(full_a - full_b) <= 1e-9 * sds[:, :, None] * sds[:, None, :]).all()
        else:
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-10, err_msg=name)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("name", NETWORKS)
def test_kernels_agree_with_the_oracle(name, preset, seed):
    net, rng = NETWORKS[name], np.random.default_rng(seed)
    options = {"preset": preset, "particles": 21, "scenarios": 21}
    if name == "two-rooms" and preset == "jump":
        options["volatility_blocks"] = {"a": ["T_a"], "b": ["T_b"]}
    oracle, kernels = (
        build("mkf", net, PERIOD, options | {"implementation": which}) for which in ("reference", "compiled")
    )
    outputs = 20 + 0.1 * rng.standard_normal((8, len(net.measured)))
    outputs[4, 0] = np.nan
    state = oracle.start(seed, outputs[0], inputs_of(net, rng))
    for y in outputs[1:]:
        inputs = inputs_of(net, rng)
        left, right = (estimator.predict(state, inputs) for estimator in (oracle, kernels))
        assert_same(left, right, state)
        moved, likely = oracle._moves.assimilate(left.particles(), y)
        moved_too, likely_too = kernels._moves.assimilate(left.particles(), y)
        assert_same(moved, moved_too, left)
        np.testing.assert_allclose(likely, likely_too, rtol=1e-9, atol=1e-9)
        learned, also = (estimator.update(left, y) for estimator in (oracle, kernels))
        np.testing.assert_allclose(learned.state.log_weights, also.state.log_weights, rtol=1e-9, atol=1e-9)
        for a, b in zip(learned[2:4], also[2:4], strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(*(each.disturbance(inputs).gain for each in (learned, also)), rtol=1e-7, atol=1e-6)
        state = learned.state
    plan = np.array([inputs_of(net, rng) for _ in range(6)])
    left, right = (estimator.scenarios(state, plan, 21) for estimator in (oracle, kernels))
    np.testing.assert_allclose(left, right, rtol=1e-9)
    levels = np.array([0.1, 0.5, 0.9])
    left, right = (estimator.parameters(state, levels) for estimator in (oracle, kernels))
    np.testing.assert_allclose(left.parameters, right.parameters, rtol=1e-9)
    if net.terms:
        np.testing.assert_allclose(left.coefficients, right.coefficients, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", NETWORKS)
def test_derivatives_are_exact(name):
    net, rng = NETWORKS[name], np.random.default_rng(5)
    estimator = build("mkf", net, PERIOD, {"preset": "drift", "particles": 8, "parameter_sd": 0.0})
    inputs = inputs_of(net, rng)
    start = estimator.start(3, np.full(len(net.measured), 20.0), inputs)
    states, size = len(net.nodes), start.mean.shape[0]
    mean = start.mean + np.r_[rng.uniform(0, 5, states), 1.0, np.zeros(size - states - 1)][:, None]
    diagonal = [packed(i, i) for i in range(size)]
    covariance = np.zeros_like(start.covariance)
    covariance[diagonal] = 1.0
    base = start._replace(mean=mean, covariance=covariance)
    crossed = unpack(estimator.predict(base, inputs).covariance)[:, :states]
    # The gain itself decays over the step, so that its covariance with x' is its derivative times what is left of it.
    left = estimator.predict(base, inputs).mean[states] / mean[states]
    step = 1e-4
    for j in range(states, size):
        shift = np.zeros((size, 1))
        shift[j] = step
        higher, lower = (estimator.predict(base._replace(mean=mean + s * shift), inputs).mean for s in (1, -1))
        slope = (higher - lower)[:states] / (2 * step)
        derivative = crossed[:, :, j].T / (left if j == states else 1.0)
        # What central differences leave is of the order of the step squared.
        assert np.abs(slope - derivative).max() < 1e-7 * max(1.0, np.abs(slope).max())


def test_it_is_a_kalman_filter_where_all_is_known():
    data, net = record(80, seed=1, process_sd=0.02), known(building())
    estimator = build("mkf", net, PERIOD, {"preset": "free", "process_sd": 0.02, "particles": 8, "parameter_sd": 0.0})
    state = estimator.start(1, data.outputs[0], data.inputs[0])
    mean, sds, total = [], [], 0.0
    start = state.mean[:, 0].copy(), unpack(state.covariance)[0]
    for u, y in zip(data.inputs[:-1], data.outputs[1:], strict=True):
        state = estimator.predict(state, u)
        mixture = estimator.predictive(state)
        mean.append(mixture.mean())
        sds.append(mixture.sd())
        posterior = estimator.update(state, y)
        total += posterior.log_likelihood
        state = posterior.state
    expected = textbook_kalman(net, TRUTH, PERIOD, start, data, 0.02, 0.05, [0])
    np.testing.assert_allclose(mean, expected[0], rtol=1e-9)
    np.testing.assert_allclose(sds, expected[1], rtol=1e-9)
    assert total == pytest.approx(expected[2], rel=1e-9)


def test_the_start_has_the_moments_of_the_prior():
    estimator = build("mkf", building(), PERIOD, {"particles": 20_000})
    state = estimator.start(1, np.array([20.0]), np.array([5.0, 0.0]))
    phi = state.mean[3:]
    own = state.covariance[[packed(i, i) for i in range(3, 7)]].mean(axis=1)
    prior = np.array([np.log(30.0) ** 2 / 12] * 4)
    # The relative error of a variance from N draws is sqrt(2 / N) at most for bounded densities: 1 %.
    np.testing.assert_allclose(phi.var(axis=1) + own, prior, rtol=0.04)


def test_it_finds_an_unmeasured_gain_and_the_noise_of_the_sensor():
    rng, steps = np.random.default_rng(3), 900
    data = record(steps, seed=3)
    gain = np.where((np.arange(steps) % 150) > 110, 2500.0, 0.0)
    states = simulate(
        building(), TRUTH, data.inputs, PERIOD, x0=np.array([20.0, 17.0]), process_noise_sd=0.0, rng=rng,
        unmeasured=np.column_stack([gain, np.zeros(steps)]),
    )  # fmt: skip
    outputs = states[:, :1] + 0.05 * rng.standard_normal((steps, 1))
    estimator = build("mkf", building(), PERIOD, {})
    state = estimator.start(1, outputs[0], data.inputs[0])
    found = []
    for u, y in zip(data.inputs[:-1], outputs[1:], strict=True):
        posterior = estimator.update(estimator.predict(state, u), y)
        state = posterior.state
        found.append(posterior.disturbance(u))
    late = slice(600, None)
    on = gain[:-1][late] > 0
    certain = np.array([each.probability_on for each in found])[late]
    medians = np.array([each.gain[1] for each in found])[late]
    assert np.median(certain[on]) > 0.95
    assert np.median(certain[~on]) < 0.2
    assert abs(np.median(medians[on]) - 2500.0) < 0.2 * 2500.0
    low, middle, high = found[-1].measurement_sd[0]
    assert low <= middle <= high
    assert 0.03 < middle < 0.08


def test_a_gain_that_is_as_good_as_never_on_is_none():
    estimator = build("mkf", network("tite"), PERIOD, {"particles": 8})
    state = estimator.start(1, np.array([20.0]), np.array([5.0, 0.0]))
    on = np.where(np.arange(8) == 0, 1.0, 0.0)
    state = state._replace(gain_on=on[None], log_weights=np.where(on > 0.0, -740.0, -np.log(7.0)))
    np.testing.assert_array_equal(estimator.update(state, np.array([np.nan])).disturbance(np.zeros(2)).gain, 0.0)


def test_parameters_come_close_to_the_truth_and_their_intervals_hold_it():
    data, net = record(1000, seed=2, process_sd=0.01), building()
    estimator = build("mkf", net, PERIOD, {"preset": "output-error", "measurement_sd": 0.05, "process_sd": 0.01})
    state = after(estimator, data.inputs, data.outputs)
    summary = estimator.parameters(state, np.array([0.001, 0.5, 0.999]))
    truth = np.array([TRUTH[parameter.name] for parameter in net.parameters])
    assert (summary.parameters[:, 0] < truth).all()
    assert (truth < summary.parameters[:, 2]).all()
    np.testing.assert_allclose(summary.parameters[:, 1], truth, rtol=0.25)
    # Particles that sample nothing are not copied: those without weight are gone.
    assert state.mean.shape[1] < estimator.options.particles


def test_what_lasts_for_hours_is_no_news_about_parameters():
    """Heat that nobody measures, of 300 W and six hours: only who knows that errors last has intervals that hold."""
    net, left = building(), np.exp(-PERIOD / (6 * 3600))
    truth, held = np.array([TRUTH[parameter.name] for parameter in net.parameters]), {0.0: [], 6.0: []}
    for seed in (1, 2, 3):
        data, noise = record(1000, seed), np.random.default_rng(seed).standard_normal(1000)
        told = data.inputs.copy()
        told[:, 1] -= lfilter([300.0 * np.sqrt(1.0 - left**2)], [1.0, -left], noise)
        for hours, found in held.items():
            options = {"measurement_sd": 0.05, "process_sd": 0.01, "error_hours": hours}
            estimator = build("mkf", net, PERIOD, {"preset": "output-error", **options})
            state = after(estimator, told, data.outputs)
            low, high = estimator.parameters(state, np.array([0.025, 0.975])).parameters.T
            found += ((low < truth) & (truth < high)).tolist()
    assert np.mean(held[0.0]) < 0.5 < 0.8 < np.mean(held[6.0])


@pytest.mark.parametrize("preset", ["jump", "drift", "free"])
def test_scenarios_are_distributed_as_the_prediction(preset):
    data, particles = record(60, seed=6), 2000
    options = {"preset": preset, "parameter_sd": 0.0, "particles": particles, "scenarios": 20_000}
    estimator = build("mkf", building(), PERIOD, options)
    state = after(estimator, data.inputs, data.outputs)
    expected = estimator.predictive(estimator.predict(state, data.inputs[0]))
    drawn = unfolded(estimator, state, data.inputs[:1])[1]
    levels = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
    at = drawn.quantiles(levels, 0)
    reached = expected.weights @ ndtr((at - expected.means[0][:, None]) / expected.sds[0][:, None])
    # At least half of the particles count, for else they are resampled; four standard deviations of such a share.
    np.testing.assert_allclose(reached, levels, atol=4 * np.sqrt(0.25 / (particles / 2)))


def test_one_of_two_outputs_may_be_missing():
    estimator = build("mkf", two_rooms(), PERIOD, {"particles": 32})
    state = estimator.predict(estimator.start(1, np.array([20.0, 18.0]), np.zeros(3)), np.zeros(3))
    posterior = estimator.update(state, np.array([np.nan, 18.1]))
    assert np.isfinite(posterior.log_likelihood)
    assert posterior.disturbance(np.zeros(3)).measurement_sd.shape == (2, 3)
    assert posterior.log_likelihood != estimator.update(state, np.array([20.0, np.nan])).log_likelihood


def test_it_finds_the_sun_of_the_facades_and_the_habits_of_people():
    """A room that people heat by day, less on weekends, and the sun through windows to the south and west."""
    rng, days = np.random.default_rng(5), 40
    place = Location(47.87, 11.73)
    base = building()
    base = replace(base, heat_inputs=(*base.heat_inputs, HeatInput("I_sol", "T_i", Gain(0.0), "W/m2"))).validate()
    net = with_known_heat(base, habits=True, sun="facades", location=place)
    times = 1380585600.0 + PERIOD * np.arange(days * 144)
    hours = times / 3600 % 24
    clouds = np.repeat(rng.uniform(0.1, 1.0, days * 8), 18)
    light = 500.0 * np.maximum(np.sin(2 * np.pi * (hours - 6) / 24), 0.0) * clouds
    heat = 3000.0 * np.repeat(rng.integers(0, 2, days * 12), 12)
    inputs = np.column_stack([5 + 4 * np.sin(2 * np.pi * hours / 24), heat, light])

    def calendar(when):
        return LocalTime(when / 3600 % 24, when / 3600 % 24, (when // 86400 % 7 < 2).astype(float))

    drive = KnownHeat(net, PERIOD, calendar, place).drive(times, inputs)
    truth = {"sun_south": 2.5, "sun_west": 1.0, "habit_06": 300.0, "habit_09": 150.0, "habit_18": 500.0,
             "habit_21": 250.0, "habit_weekend_09": 200.0}  # fmt: skip
    coefficients = np.array([truth.get(term.name, 0.0) for term in net.terms])
    known = drive[:, len(net.inputs) :] @ coefficients
    states = simulate(
        base, TRUTH, inputs, PERIOD, x0=np.array([20.0, 17.0]), process_noise_sd=0.005, rng=rng,
        unmeasured=np.column_stack([known, np.zeros(len(times))]),
    )  # fmt: skip
    outputs = states[:, :1] + 0.03 * rng.standard_normal((len(times), 1))
    estimator = build("mkf", net, PERIOD, {"preset": "habits", "gain": "none", "measurement_sd": 0.03})
    state = after(estimator, drive, outputs)
    low, found, high = estimator.parameters(state, np.array([0.001, 0.5, 0.999])).coefficients.T
    assert ((low <= coefficients) & (coefficients <= high)).all()
    for name, value in truth.items():
        at = [term.name for term in net.terms].index(name)
        assert abs(found[at] - value) < (0.5 if net.terms[at].unit == "m2" else 100.0)
    # What its draws say is what its own futures are: the coefficients are in the matrices too.
    path = mean_path(of_draws(estimator.draws(state, 200), PERIOD, 1), drive[:144])
    np.testing.assert_allclose(path, estimator.scenarios(state, drive[:144], 200).mean(axis=0), atol=0.1)
