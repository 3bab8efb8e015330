"""Presets and options of the filters."""

import pytest
from support.tables import tabled

from estimator import registry
from estimator.errors import OptionsError
from estimator.network.presets import network

BUILDING = network("building-67")


def resolve(name, given, period=600.0, of=BUILDING):
    return registry.resolve(name, of, period, given)


@tabled
def test_a_mistake_is_named(name, given, gist):
    with pytest.raises(OptionsError) as caught:
        resolve(name, given)
    assert gist in str(caught.value)


@pytest.mark.parametrize("period", [1, 60, 21600, 86400])
@pytest.mark.parametrize(
    ("name", "preset"),
    [
        *((name, preset) for name in ("rbpf", "ekf", "ukf") for preset in ("default", "paper")),
        *(("mkf", preset) for preset in ("jump", "drift", "free", "steady", "output-error", "habits")),
    ],
)
def test_options_in_force_resolve_to_themselves_at_every_period(name, preset, period):
    options = resolve(name, {"preset": preset, "process_sd": 0.5}, period)
    assert resolve(name, registry.as_mapping(options), period) == options


def test_the_paper_presets_are_the_papers():
    semi_synthetic = resolve("rbpf", {"preset": "paper"})
    assert (semi_synthetic.particles, semi_synthetic.alpha_min, semi_synthetic.alpha_max) == (9000, 0.01, 25.0)
    assert (semi_synthetic.volatility_sd, semi_synthetic.process_sd, semi_synthetic.measurement_sd) == (0.1, 0.01, 0.15)
    assert (semi_synthetic.gate_low, semi_synthetic.gate_high, semi_synthetic.gate_min) == (0.40, 0.95, 0.05)
    assert (semi_synthetic.histogram_bins, semi_synthetic.histogram_pseudo_count) == (30, 1)
    assert semi_synthetic.shrinkage == pytest.approx(0.974, abs=5e-4)
    assert (semi_synthetic.coordinates, semi_synthetic.moment_preserving) == ("log", False)
    assert semi_synthetic.jump_probability == 0
    ecolar = resolve("rbpf", {"preset": "paper"}, 300.0, network("ecolar-6r4c"))
    assert (ecolar.particles, ecolar.alpha_max, ecolar.volatility_sd) == (20000, 15.0, 0.05)
    assert (ecolar.process_sd, ecolar.measurement_sd) == (0.03, 0.1)
    kalman = resolve("ekf", {"preset": "paper"})
    assert (kalman.measurement_sd, kalman.process_sd, kalman.initial) == (0.15, 0.03, "drawn")
    assert kalman.parameter_sd**2 == pytest.approx(1e-4)
    assert resolve("ukf", {"preset": "paper"}, 300.0, network("ecolar-6r4c")).measurement_sd == 0.1


@tabled
def test_two_short_steps_add_the_variance_of_a_long_one_and_jump_as_often(name, given, walks, chances):
    long, short = resolve(name, given), resolve(name, given, 300.0)
    for walk in walks:
        assert 2 * getattr(short, walk) ** 2 == pytest.approx(getattr(long, walk) ** 2), walk
    for chance in chances:
        assert (1 - getattr(short, chance)) ** 2 == pytest.approx(1 - getattr(long, chance)), chance
    if name == "rbpf":
        assert short.shrinkage**2 == pytest.approx(long.shrinkage)
        assert long.jump_probability == pytest.approx(0.02)
    if name == "mkf":
        assert short.measurement_sd == long.measurement_sd == 0.05
    assert resolve(name, given | {"process_sd": 0.01}, 2400.0).process_sd == 0.01


def test_given_options_win_over_the_preset():
    options = resolve("rbpf", {"preset": "paper", "particles": 100, "discount": 0.99})
    assert options.particles == 100
    assert options.shrinkage == pytest.approx((3 * 0.99 - 1) / (2 * 0.99))
    assert resolve("ukf", {"sigma_reach": 2}).sigma_reach == 2.0
    effective = registry.as_mapping(resolve("rbpf", {"particles": 500}))
    assert effective["coordinates"] == "logit"
    assert registry.build("rbpf", BUILDING, 600.0, effective).options.particles == 500
