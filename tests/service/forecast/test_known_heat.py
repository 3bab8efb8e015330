"""Sun and habits in what a zone tells a controller: its matrices, its coupled simulation and its coefficients."""

import numpy as np
import pytest
from support.forecasts import asked, mean_path
from support.zone_samples import sample

from estimator.heat.known import KnownHeat
from estimator.heat.sun import Location
from estimator.heat.terms import with_known_heat
from estimator.network.presets import automatic
from estimator.registry import build
from estimator.statespace.matrices import of_draws, of_point
from estimator.statespace.simulate import Simulation
from service.forecast.foresight import foresee
from service.forecast.learned import ModelQuestion
from service.forecast.room import Past, RoomQuestion
from service.zone.local_time import calendar
from service.zone.worker import WorkerSettings, ZoneWorker

PERIOD = 600
PLACE = Location(47.87, 11.73)
NETWORK = with_known_heat(automatic(["T_i", "T_out", "u_heat", "I_sol"]), habits=True, sun="facades", location=PLACE)


@pytest.fixture(scope="module")
def worker():
    """A zone on a sunny day in June."""
    hours = calendar("Europe/Berlin", None, PLACE)
    estimator = build("mkf", NETWORK, PERIOD, {"preset": "habits"})
    found = ZoneWorker(estimator, WorkerSettings(1, (0.95,), 12, 900.0), KnownHeat(NETWORK, PERIOD, hours, PLACE))
    begin = 1371506400  # midnight in Berlin
    for k in range(100):
        sun = 800.0 * max(0.0, np.sin(2 * np.pi * (k * PERIOD / 3600 - 6) / 24))
        found.step(sample(0, 20.0 + 0.01 * k, [15.0, 300.0, sun])._replace(time=begin + k * PERIOD))
    return found


def test_matrices_have_the_measured_inputs_and_known_heat_beside_them(worker):
    model, standing = asked(worker, ModelQuestion(3, 16, "mkf")), worker.unstalled
    assert standing is not None
    inputs = len(NETWORK.inputs)
    assert model.mean.B.shape == (4, inputs)
    assert model.draws.B.shape == (16, 4, inputs)
    assert model.known_heat.shape == (48, 4)
    # Simulated with it, the mean model goes where it goes under the whole drive rows.
    drawn = worker.estimator.draws(standing.state, 16)
    assert drawn is not None
    rows = foresee(worker, standing, 3).rows
    times = standing.update.forecast.valid_time + PERIOD * np.arange(3.0)
    expected = mean_path(of_point(drawn, PERIOD, 1), worker.loop.driving(times, rows))[-1]
    state = model.mean.A @ model.mean.state + model.mean.B @ rows.mean(axis=0) + model.known_heat[0]
    # Inputs and known heat vary a little within the half hour.
    np.testing.assert_allclose(model.mean.C @ state, expected, atol=0.02)
    assert np.abs(model.known_heat).max() > 0.0


def test_heat_of_people_is_what_nobody_measured_and_counts_habits_once(worker):
    gain = worker.latest.disturbance.gain
    times = worker.latest.time + PERIOD * np.arange(144.0)
    inputs = np.tile([15.0, 300.0, 0.0], (144, 1))
    past = Past(times, PERIOD, np.full(144, 20.0), np.full(144, np.nan), np.tile(gain, (144, 1)), inputs)
    np.testing.assert_allclose(np.array(asked(worker, RoomQuestion(past)).people), gain[1])
    habits = np.array(asked(worker, RoomQuestion(past._replace(gain=np.full((144, 3), np.nan)))).people)
    assert habits.std() > 0.0
    assert 0.0 < habits.mean() < 400.0


def test_a_simulation_step_by_step_is_driven_as_a_plan_is(worker):
    standing = worker.unstalled
    drawn = worker.estimator.draws(standing.state, 8)
    assert drawn is not None
    models, first = of_draws(drawn, PERIOD, 1), float(standing.update.forecast.valid_time)
    rows = foresee(worker, standing, 12).rows

    def driving(step, inputs):
        return worker.loop.driving(np.array([first + PERIOD * step]), inputs[None])[0]

    simulation = Simulation(models, driving)
    path = []
    for row in rows:
        path.append(simulation.outputs())
        simulation.step(row)
    expected = mean_path(models, worker.loop.driving(first + PERIOD * np.arange(12.0), rows))
    np.testing.assert_allclose([*path, simulation.outputs()], expected, rtol=1e-12)
    np.testing.assert_array_equal(simulation.anew().outputs(), path[0])
