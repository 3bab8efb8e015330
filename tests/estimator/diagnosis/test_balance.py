"""The energy balance of a simulated building, and a learned heat loss that contradicts it."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.diagnosis.balance import against_balance, balance, known_heat
from estimator.diagnosis.finding import AGAINST_BALANCE
from estimator.diagnosis.record import no_record, with_sample
from estimator.network.assembly import assemble, theta_vector
from estimator.network.discretise import heat_loss
from estimator.network.network import Gain, HeatInput
from estimator.network.presets import SOLAR_APERTURE, network
from estimator.types import ParameterSummary
from replay.simulated.simulate import simulate

PERIOD = 1800.0
SUNNY = network("titethria").with_solar("T_i", SOLAR_APERTURE)
NEIGHBOURED = network("ecolar-6r4c")


def simulated(net, days, power):
    """A record of `net` with its nominal parameters and a heater that switches, `power` W on average."""
    steps = int(days * 48)
    hours = np.arange(steps) / 2.0
    rng = np.random.default_rng(3)
    columns = {
        "T_out": 8.0 + 3.0 * np.sin(2 * np.pi * hours / 24),
        "T_adj": 18.0 + np.sin(2 * np.pi * hours / 24 + 1.0),
        "u_heat": 2 * power * np.repeat(rng.integers(0, 2, steps // 6 + 1), 6)[:steps],
        "I_sol": np.maximum(0.0, 300.0 * np.sin(2 * np.pi * (hours - 6) / 24)),
    }
    inputs = np.column_stack([columns[name] for name in net.inputs])
    theta = {p.name: p.nominal for p in net.parameters}
    states = simulate(net, theta, inputs, PERIOD, x0=np.full(len(net.nodes), 20.0), process_noise_sd=0.0, rng=rng)
    record = no_record(len(net.inputs))
    place = net.nodes.index(net.measured[0])
    for step in range(steps):
        record = with_sample(record, step * PERIOD, PERIOD, float(states[step, place]), inputs[step])
    return record


def nominal(net):
    return theta_vector(net)[:, 0]


def true_loss(net):
    return float(heat_loss(assemble(net, theta_vector(net)), net.nodes.index(net.measured[0]))[0])


@pytest.mark.parametrize(("net", "power"), [(SUNNY, 900.0), (NEIGHBOURED, 600.0)])
def test_the_balance_of_a_simulated_building_is_its_heat_loss(net, power):
    found = balance(net, nominal(net), simulated(net, 14, power))
    assert found.heat_loss == pytest.approx(true_loss(net), rel=0.15)
    assert found.days >= 10


def test_the_balance_does_not_depend_on_the_loss_that_was_learned():
    theta = nominal(SUNNY)
    for name in ("g_ie", "g_e_out", "g_i_out"):
        theta[[p.name for p in SUNNY.parameters].index(name)] *= 0.3
    assert balance(SUNNY, theta, simulated(SUNNY, 14, 900.0)).heat_loss == pytest.approx(true_loss(SUNNY), rel=0.2)


def summary(net, factor):
    """Quantiles as narrow as a filter's that is too sure, with `factor` times the conductances to the outside."""
    theta = nominal(net)
    for place, parameter in enumerate(net.parameters):
        theta[place] *= factor if parameter.unit == "W/K" else 1.0
    levels = np.array([0.025, 0.5, 0.975])
    spread = np.array([0.9, 1.0, 1.1])
    return ParameterSummary(levels, theta[:, None] * spread, np.ones((3, 3)), factor * true_loss(net) * spread)


@pytest.mark.parametrize(("factor", "names"), [(0.3, [AGAINST_BALANCE]), (1.0, []), (3.5, [AGAINST_BALANCE])])
def test_a_heat_loss_far_from_the_balance_is_a_finding(factor, names):
    found = against_balance(SUNNY, summary(SUNNY, factor), simulated(SUNNY, 14, 900.0))
    assert [finding.finding for finding in found] == names
    for finding in found:
        assert finding.subject == "heat_loss"
        assert finding.sentence.endswith("; check unit and scale of u_heat, and whether other heating is not measured")


@pytest.mark.parametrize(("days", "power"), [(3, 900.0), (14, 0.0), (14, 150.0)])
def test_a_record_that_is_too_short_or_hardly_heated_allows_no_balance(days, power):
    assert balance(SUNNY, nominal(SUNNY), simulated(SUNNY, days, power)) is None


def test_heat_with_a_learned_gain_is_not_known_and_shares_of_it_are():
    assert known_heat(SUNNY) == ("u_heat",)
    assert known_heat(network("m5")) == ("u_heat",)
    heat = (HeatInput("u_heat", "T_air", Gain(parameter="f_air")),)
    assert known_heat(replace(network("m5"), heat_inputs=heat)) == ()
