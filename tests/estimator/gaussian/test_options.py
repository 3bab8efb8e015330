"""Presets and options of EKF and UKF."""

import pytest

from estimator.errors import OptionsError
from estimator.gaussian.options import resolve_ekf, resolve_ukf
from estimator.network.presets import network
from estimator.registry import as_mapping

BUILDING = network("building-67")

MISTAKES = {
    "unknown": ({"particles": 10}, "unknown option 'particles'; the options of 'ekf' are initial, measurement_sd"),
    "ukf only": ({"sigma_reach": 1.0}, "unknown option 'sigma_reach'"),
    "preset": ({"preset": "fast"}, "preset 'fast' does not exist; the presets are default, paper"),
    "sd": ({"measurement_sd": 0.0}, "measurement_sd = 0.0 must be a number from 1e-06"),
    "text": ({"parameter_sd": "small"}, "parameter_sd = 'small' must be a number"),
    "nan": ({"process_sd": float("nan")}, "must be a number"),
    "start": ({"initial": "guess"}, "initial = 'guess' must be one of centre, drawn"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named(mistake):
    given, gist = MISTAKES[mistake]
    with pytest.raises(OptionsError) as caught:
        resolve_ekf(BUILDING, 600.0, given)
    assert gist in str(caught.value)


def test_the_ukf_has_one_option_more():
    assert resolve_ukf(BUILDING, 600.0, {"sigma_reach": 2}).sigma_reach == 2.0
    with pytest.raises(OptionsError, match=r"sigma_reach = 0 must be a number from 0\.01 to 10"):
        resolve_ukf(BUILDING, 600.0, {"sigma_reach": 0})


def test_the_paper_preset_is_the_papers():
    options = resolve_ekf(BUILDING, 600.0, {"preset": "paper"})
    assert (options.measurement_sd, options.process_sd, options.initial) == (0.15, 0.03, "drawn")
    assert options.parameter_sd**2 == pytest.approx(1e-4)
    assert resolve_ukf(network("ecolar-6r4c"), 300.0, {"preset": "paper"}).measurement_sd == 0.1


def test_per_step_noise_of_the_default_preset_scales_with_the_period():
    long, short = resolve_ukf(BUILDING, 600.0, {}), resolve_ukf(BUILDING, 300.0, {})
    assert 2 * short.process_sd**2 == pytest.approx(long.process_sd**2)
    assert 2 * short.parameter_sd**2 == pytest.approx(long.parameter_sd**2)


@pytest.mark.parametrize("resolve", [resolve_ekf, resolve_ukf])
def test_the_options_in_force_resolve_to_themselves(resolve):
    options = resolve(BUILDING, 600.0, {"preset": "paper", "process_sd": 0.5})
    assert resolve(BUILDING, 600.0, as_mapping(options)) == options
