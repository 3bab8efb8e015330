"""A zone whose thermostats look at its temperature: the simulated building in closed loop."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.arrays import Array
from estimator.network.network import Network
from replay.simulated.simulate import Dynamics


class Panel(NamedTuple):
    """An electric heater behind a relay, which switches on below set-point - `offset` - `hysteresis` / 2 and off above
    set-point - `offset` + `hysteresis` / 2 (K), and only at every `cycle`-th step."""

    power: float
    offset: float
    hysteresis: float
    cycle: int


class Loads(NamedTuple):
    """What acts on the zone at each of K steps: `set_point` (K,) in degC; `forced` (K, n_panels) switches a panel on
    whatever the thermostat says, up to `ceiling` degC; `gain` (K,) in W and `opening` (K,) in W/K (air exchanged with
    outdoors) go into the first measured node; `noise` (K, n_x) in K is added to the state after each step."""

    set_point: Array
    forced: npt.NDArray[np.bool_]
    gain: Array
    opening: Array
    noise: Array
    ceiling: float = 26.0


class Heated(NamedTuple):
    """Temperatures (K, n_x) in degC, panel powers (K, n_panels) and unmeasured gain (K,), openings included, in W."""

    states: Array
    powers: Array
    unmeasured: Array


def simulate_heated(
    network: Network, step: Dynamics, boundaries: Array, loads: Loads, panels: tuple[Panel, ...], *, x0: Array
) -> Heated:
    """Simulate `network` (one heat input, u_heat in W) under thermostats. Row k of `boundaries` (K, n_boundaries) and
    `loads` holds over step k, as do the powers and the exchange by the temperatures at its beginning."""
    samples, n_b = boundaries.shape
    air, outdoor = network.nodes.index(network.measured[0]), network.boundaries.index("T_out")
    heater, into_air = step.input[:, network.inputs.index("u_heat")], step.heat[:, air]
    drive = boundaries @ step.input[:, :n_b].T + loads.gain[:, None] * into_air + loads.noise
    states = np.empty_like(drive)
    powers = np.zeros((samples, len(panels)))
    unmeasured = loads.gain.copy()
    on = [False] * len(panels)
    states[0] = x0
    for k in range(samples):
        temperature = states[k, air]
        for j, panel in enumerate(panels):
            if k % panel.cycle == 0:
                excess = temperature - loads.set_point[k] + panel.offset
                if abs(excess) > panel.hysteresis / 2:
                    on[j] = excess < 0
            if on[j] or (loads.forced[k, j] and temperature < loads.ceiling):
                powers[k, j] = panel.power
        airing = loads.opening[k] * (boundaries[k, outdoor] - temperature)
        unmeasured[k] += airing
        if k + 1 < samples:
            states[k + 1] = step.transition @ states[k] + drive[k] + heater * powers[k].sum() + into_air * airing
    return Heated(states, powers, unmeasured)
