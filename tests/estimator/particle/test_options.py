"""Presets and options of the particle filter."""

import pytest

from estimator import registry
from estimator.errors import OptionsError
from estimator.network.presets import network
from estimator.particle.options import resolve

BUILDING = network("building-67")

MISTAKES = {
    "unknown": ({"particle": 10}, "unknown option 'particle'"),
    "preset": ({"preset": "fast"}, "preset 'fast' does not exist; the presets are default, paper"),
    "preset list": ({"preset": ["paper"]}, "preset '['paper']' does not exist"),
    "blocks nodes": ({"volatility_blocks": {"a": [1, "T_i"]}}, "must name every state node exactly once"),
    "particles": ({"particles": 0}, "particles = 0 must be a whole number from 50"),
    "particles float": ({"particles": 100.5}, "must be a whole number"),
    "particles bool": ({"particles": True}, "must be a whole number"),
    "sd": ({"measurement_sd": -1.0}, "measurement_sd = -1.0 must be a number from"),
    "text": ({"process_sd": "small"}, "process_sd = 'small' must be a number"),
    "nan": ({"process_sd": float("nan")}, "must be a number"),
    "gate": ({"gate_low": 0.9, "gate_high": 0.5}, "gate_low = 0.9 must be below gate_high = 0.5"),
    "alpha": ({"alpha_min": 2.0}, "must have 1, where the volatility starts, between them"),
    "alpha reversed": ({"alpha_min": 5.0, "alpha_max": 2.0}, "alpha_min = 5 must be below alpha_max = 2"),
    "coordinates": ({"coordinates": "linear"}, "coordinates = 'linear' must be one of log, logit"),
    "flag": ({"moment_preserving": 1}, "moment_preserving = 1 must be true or false"),
    "both": ({"discount": 0.95, "shrinkage": 0.9}, "give one of them"),
    "discount": ({"discount": 0.4}, "discount = 0.4 must be a number above 0.5"),
    "blocks type": ({"volatility_blocks": ["T_i"]}, "must be a table of block name"),
    "blocks incomplete": ({"volatility_blocks": {"air": ["T_i"]}}, "must name every state node exactly once"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named(mistake):
    given, gist = MISTAKES[mistake]
    with pytest.raises(OptionsError) as caught:
        resolve(BUILDING, 600.0, given)
    assert gist in str(caught.value)


def test_the_paper_preset_is_the_papers():
    semi_synthetic = resolve(BUILDING, 600.0, {"preset": "paper"})
    assert (semi_synthetic.particles, semi_synthetic.alpha_min, semi_synthetic.alpha_max) == (9000, 0.01, 25.0)
    assert (semi_synthetic.volatility_sd, semi_synthetic.process_sd, semi_synthetic.measurement_sd) == (0.1, 0.01, 0.15)
    assert (semi_synthetic.gate_low, semi_synthetic.gate_high, semi_synthetic.gate_min) == (0.40, 0.95, 0.05)
    assert (semi_synthetic.histogram_bins, semi_synthetic.histogram_pseudo_count) == (30, 1)
    assert semi_synthetic.shrinkage == pytest.approx(0.974, abs=5e-4)
    assert (semi_synthetic.coordinates, semi_synthetic.moment_preserving) == ("log", False)
    assert semi_synthetic.jump_probability == 0
    ecolar = resolve(network("ecolar-6r4c"), 300.0, {"preset": "paper"})
    assert (ecolar.particles, ecolar.alpha_max, ecolar.volatility_sd) == (20000, 15.0, 0.05)
    assert (ecolar.process_sd, ecolar.measurement_sd) == (0.03, 0.1)


def test_per_step_noise_of_the_default_preset_scales_with_the_period():
    """Twelve 5-minute steps and six 10-minute steps add the same variance, forget as much and jump as often."""
    long, short = resolve(BUILDING, 600.0, {}), resolve(BUILDING, 300.0, {})
    assert 12 * short.volatility_sd**2 == pytest.approx(6 * long.volatility_sd**2)
    assert 12 * short.process_sd**2 == pytest.approx(6 * long.process_sd**2)
    assert short.shrinkage**12 == pytest.approx(long.shrinkage**6)
    assert (1 - short.jump_probability) ** 12 == pytest.approx((1 - long.jump_probability) ** 6)
    assert long.jump_probability == pytest.approx(0.02)


def test_given_options_win_over_the_preset_and_discount_sets_the_shrinkage():
    options = resolve(BUILDING, 600.0, {"preset": "paper", "particles": 100, "discount": 0.99})
    assert options.particles == 100
    assert options.shrinkage == pytest.approx((3 * 0.99 - 1) / (2 * 0.99))


def test_the_registry_names_the_estimators():
    with pytest.raises(OptionsError, match="unknown estimator 'magic'; the estimators are rbpf, ekf, ukf"):
        registry.resolve("magic", BUILDING, 600.0, {})
    effective = registry.as_mapping(registry.resolve("rbpf", BUILDING, 600.0, {"particles": 500}))
    assert effective["particles"] == 500
    assert effective["coordinates"] == "logit"
    assert registry.build("rbpf", BUILDING, 600.0, effective).options.particles == 500


@pytest.mark.parametrize("period", [1, 60, 21600, 86400])
@pytest.mark.parametrize("preset", ["default", "paper"])
def test_every_preset_accepts_every_period(preset, period):
    assert resolve(BUILDING, period, {"preset": preset}).preset == preset
