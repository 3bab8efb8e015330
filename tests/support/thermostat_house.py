"""A house with a thermostat, as its logger records it."""

import numpy as np
import pandas as pd

from service.records.sample import Sample

THETA = np.array([6e6, 4e7, 600.0, 140.0])
"""C_i, C_e, g_ie, g_e_out of the network `tite`."""


def morning(hour: float) -> float:
    """A set-point [degC] by the hours since the first midnight: the same on all days."""
    return 21.0 if 6.5 <= hour % 24.0 < 22.0 else 17.0


def proportional(excess):
    """Heat [W] at `excess` K above the set-point."""
    return 6000.0 * float(np.clip(0.2 - excess / 1.5, 0.0, 1.0))


def recorded(days, period, setpoint=morning, power=proportional):
    """Outputs (n, 1), inputs (n, 2) and set-points (n,) of a house whose heater follows `power`, every `period` s."""
    rng = np.random.default_rng(2)
    indoor, envelope = 20.0, 17.0
    outputs, inputs, wanted = [], [], []
    for k in range(days * 86400 // period):
        hour = k * period / 3600.0
        outdoor = 3.0 + 5.0 * np.sin(2.0 * np.pi * hour / 24.0)
        heat = power(indoor - setpoint(hour))
        outputs.append(indoor + 0.03 * rng.standard_normal())
        inputs.append((outdoor, heat))
        wanted.append(setpoint(hour))
        for _ in range(period // 60):
            flow = THETA[2] * (envelope - indoor)
            indoor += 60.0 / THETA[0] * (flow + heat)
            envelope += 60.0 / THETA[1] * (THETA[3] * (outdoor - envelope) - flow)
        indoor += 0.02 * rng.standard_normal()
    return np.array(outputs)[:, None], np.array(inputs), np.array(wanted)


def samples(days, period, told=True, metered=1.0, **house):
    """The same as samples: with set-points if `told`, and with `metered` times the heat."""
    for k, (outputs, inputs, setpoint) in enumerate(zip(*recorded(days, period, **house), strict=True)):
        sample = Sample.measured(k * period, outputs, inputs * [1.0, metered])
        yield sample._replace(setpoint=setpoint if told else np.nan)


def table(days):
    """The same in half hours as a table of pandas."""
    outputs, inputs, setpoints = recorded(days, 1800)
    index = pd.date_range("2025-01-10", periods=len(outputs), freq="30min", tz="Europe/Berlin")
    columns = {"T_i": outputs[:, 0], "T_out": inputs[:, 0], "u_heat": inputs[:, 1], "T_set": setpoints}
    return pd.DataFrame(columns, index=index)
