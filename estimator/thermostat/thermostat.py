"""What is known of a zone's thermostat between two samples: the last fortnight, and the laws fitted to it every day."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from estimator.arrays import DAY, Array, together, under
from estimator.network.network import Network
from estimator.thermostat.law import Laws, identified, no_laws
from estimator.thermostat.memory import Memory, in_order, no_memory, remembered

_MEMORY, _LAWS, _SETPOINT, _INPUTS = "memory.", "laws.", "setpoint", "inputs"


class Thermostat(NamedTuple):
    """The memory, the laws that were fitted to it last, and what was newest."""

    memory: Memory
    laws: Laws
    setpoint: float
    """degC; NaN where there was none."""
    inputs: Array
    """(n_u,): of the last sample; NaN before the first."""


def no_thermostat(width: int) -> Thermostat:
    """Of a zone with `width` inputs that has not been told a set-point."""
    return Thermostat(no_memory(width), no_laws(), np.nan, np.full(width, np.nan))


def with_sample(
    thermostat: Thermostat,
    network: Network,
    time: int,
    period: int,
    *,
    setpoint: float,
    temperature: float,
    inputs: Array,
    seed: int,
) -> Thermostat:
    """`thermostat` after the sample at `time` [UTC s] that stands for `period` s: its set-point and first output
    [degC], NaN where there is none, and the `inputs` (n_u,) in force.

    The laws are fitted anew once a day; `seed` spreads the zones of a site over it. That depends on the samples alone.
    """
    memory = remembered(thermostat.memory, time, period, setpoint, temperature, inputs, thermostat.inputs)
    newest, laws, phase = thermostat.setpoint if np.isnan(setpoint) else setpoint, thermostat.laws, seed % DAY
    if len(memory.times) and (time + phase) // DAY != (time + period + phase) // DAY:
        laws = identified(network, in_order(memory, time))
    return Thermostat(memory, laws, newest, inputs)


def without(thermostat: Thermostat, since: float) -> Thermostat:
    """`thermostat` that fits no law to what was measured from `since` [UTC s] on, for that is not to be believed."""
    memory = thermostat.memory
    temperatures = np.where(memory.times >= since, np.nan, memory.temperatures)
    return thermostat._replace(memory=memory._replace(temperatures=temperatures))


def pack(thermostat: Thermostat) -> dict[str, Array]:
    """Everything as arrays, by name."""
    arrays = together({_MEMORY: thermostat.memory._asdict(), _LAWS: thermostat.laws._asdict()})
    return arrays | {_SETPOINT: np.array(thermostat.setpoint), _INPUTS: thermostat.inputs}


def unpack(arrays: Mapping[str, Array], width: int) -> Thermostat:
    """What was packed, with the same bits; no thermostat in what was stored before there was one, or is of another
    number of inputs than `width`."""
    memory, laws = under(_MEMORY, arrays), under(_LAWS, arrays)
    if not memory or memory["inputs"].shape[1:] != (width,):
        return no_thermostat(width)
    return Thermostat(Memory(**memory), Laws(**laws), float(arrays[_SETPOINT]), arrays[_INPUTS])
