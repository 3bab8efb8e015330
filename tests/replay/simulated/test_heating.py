import numpy as np

from estimator.network.presets import PRESETS
from replay.simulated.heating import Heated, Loads, Panel, simulate_heated
from replay.simulated.simulate import dynamics, simulate

THETA = {"C_i": 1.8e6, "C_e": 1.9e7, "C_h": 1.5e5, "g_ie": 420.0, "g_e_out": 70.0, "g_ih": 110.0}
SAMPLES = 3 * 1440
PANEL = Panel(2500.0, 0.0, 0.5, 10)
START = np.array([20.0, 18.0, 20.0])


def _loads(**changes: np.ndarray) -> Loads:
    return Loads(
        set_point=np.full(SAMPLES, 20.0),
        forced=np.zeros((SAMPLES, 1), dtype=bool),
        gain=np.zeros(SAMPLES),
        opening=np.zeros(SAMPLES),
        noise=np.zeros((SAMPLES, 3)),
    )._replace(**changes)  # type: ignore[arg-type]


def _run(loads: Loads, outdoor: float = 0.0) -> Heated:
    boundaries = np.full((SAMPLES, 1), outdoor)
    return simulate_heated(
        PRESETS["titeth"], dynamics(PRESETS["titeth"], THETA, 60.0), boundaries, loads, (PANEL,), x0=START
    )


def test_what_it_reports_reproduces_its_temperatures_in_open_loop() -> None:
    rng = np.random.default_rng(1)
    opening = np.where(rng.random(SAMPLES) < 0.05, 60.0, 0.0)
    heated = _run(_loads(gain=rng.uniform(0, 500, SAMPLES), opening=opening))
    inputs = np.column_stack([np.zeros(SAMPLES), heated.powers.sum(axis=1)])
    unmeasured = np.column_stack([heated.unmeasured, np.zeros((SAMPLES, 2))])
    np.testing.assert_allclose(
        simulate(PRESETS["titeth"], THETA, inputs, 60.0, x0=START, unmeasured=unmeasured), heated.states, rtol=1e-10
    )
    assert (heated.unmeasured[opening > 0] < 0).all()


def test_forcing_overrides_the_thermostat_up_to_the_ceiling() -> None:
    heated = _run(_loads(forced=np.ones((SAMPLES, 1), dtype=bool)), outdoor=15.0)
    assert 25.5 < heated.states[:, 0].max() < 27.0
    assert (heated.powers[heated.states[:, 0] >= 26.0] == 0).all()
