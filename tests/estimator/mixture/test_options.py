"""Presets and options of the mixture Kalman filter."""

import pytest

from estimator.errors import OptionsError
from estimator.mixture.options import PRESETS, resolve
from estimator.network.presets import network
from estimator.registry import as_mapping

BUILDING = network("building-67")

MISTAKES = {
    "unknown": ({"shrinkage": 0.9}, "unknown option 'shrinkage'; the options of 'mkf' are alpha_initial_sd"),
    "preset": ({"preset": "paper"}, "preset 'paper' does not exist; the presets are default, jump, drift"),
    "choice": ({"gain": "sometimes"}, "gain = 'sometimes' must be one of none, switching, always"),
    "noise in words": ({"measurement_sd": "small"}, "measurement_sd = 'small' must be 'learned' or a number from"),
    "noise": ({"measurement_sd": 0.0}, "measurement_sd = 0.0 must be a number from 1e-06 to 100"),
    "flag": ({"gain_decays": 1}, "gain_decays = 1 must be true or false"),
    "order": ({"gain_sd_min": 60.0}, "gain_sd_min = 60 must not be above gain_sd_max = 50"),
    "alpha": ({"alpha_min": 2.0}, "alpha_min and alpha_max must have 1"),
    "nothing to scale": ({"volatility": "gain", "gain": "none"}, 'volatility = "gain" needs a gain'),
    "blocks": ({"volatility_blocks": {"all": ["T_i"]}}, "volatility_blocks must name every state node exactly once"),
    "blocks of a gain": (
        {"preset": "drift", "volatility_blocks": {"all": list(BUILDING.nodes)}},
        'they need volatility = "process"',
    ),
    "few": ({"particles": 3}, "particles = 3 must be a whole number from 8"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named(mistake):
    given, gist = MISTAKES[mistake]
    with pytest.raises(OptionsError) as caught:
        resolve(BUILDING, 600.0, given)
    assert gist in str(caught.value)


@pytest.mark.parametrize("preset", PRESETS)
def test_options_in_force_resolve_to_themselves(preset):
    options = resolve(BUILDING, 300.0, {"preset": preset})
    assert resolve(BUILDING, 300.0, as_mapping(options)) == options


def test_steps_of_a_process_are_scaled_to_the_period():
    usual, slow = (resolve(BUILDING, period, {"preset": "free"}) for period in (600.0, 2400.0))
    assert slow.process_sd == pytest.approx(2 * usual.process_sd)
    assert slow.parameter_sd == pytest.approx(2 * usual.parameter_sd)
    assert 1 - slow.gain_on_probability == pytest.approx((1 - usual.gain_on_probability) ** 4)
    assert slow.measurement_sd == usual.measurement_sd == 0.05
    assert resolve(BUILDING, 2400.0, {"process_sd": 0.01}).process_sd == 0.01
