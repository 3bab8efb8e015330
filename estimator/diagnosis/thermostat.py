"""A thermostat that is not obeyed: it calls and no heat comes, or heat comes that nobody called for."""

import numpy as np

from estimator.diagnosis.finding import CALLS_WITHOUT_HEAT, HEAT_WITHOUT_CALL, Finding, amount
from estimator.network.network import Network
from estimator.thermostat.law import LITTLE, MUCH, clear
from estimator.thermostat.memory import Memory, in_order, slot
from estimator.thermostat.thermostat import Thermostat

_WINDOW = 6 * 3600
_LONG = 2 * 3600
"""s of the window that must be against the law: a boiler may heat water first, a slab gives heat long after."""
_REMEDIES = {
    "heat": "check whether boiler or pump are off, a valve is stuck or the meter has failed",
    "cold": "check whether cooling unit or pump are off, a valve is stuck or the meter has failed",
}


def disobedience(network: Network, thermostat: Thermostat) -> list[Finding]:
    """The findings about the laws of `thermostat` over the last hours that it remembers."""
    laws, findings = thermostat.laws, []
    if not len(laws.column):
        return []
    time = float(np.nanmax(thermostat.memory.times))
    recent = in_order(thermostat.memory, time)
    recent = Memory(*(rows[recent.times > time - _WINDOW] for rows in recent))
    length = slot(thermostat.memory)
    for place, column in enumerate(laws.column.astype(int).tolist()):
        power = float(laws.numbers[place, 0])
        channel, side = network.inputs[column], laws.side[place]
        x = side * (recent.setpoints - recent.temperatures)
        heat = np.maximum(laws.sign[place] * recent.inputs[:, column], 0.0)
        called, idle = clear(laws.numbers[place], x)
        kind = "heat" if side > 0.0 else "cold"
        if called.sum() * length >= _LONG and heat[called].mean() < LITTLE * power:
            sentence = (
                f"the set-point called for {kind} for {amount(called.sum() * length / 3600.0)} of the last "
                f"{_WINDOW // 3600} h, and {channel} gave {amount(heat[called].mean())} W instead of "
                f"{amount(power)} W; {_REMEDIES[kind]}"
            )
            findings.append(Finding(CALLS_WITHOUT_HEAT, channel, sentence))
        # The heat of a meter of several zones may be that of others.
        if channel not in network.shares and idle.sum() * length >= _LONG and heat[idle].mean() > MUCH * power:
            sentence = (
                f"{channel} gave {amount(heat[idle].mean())} W for {amount(idle.sum() * length / 3600.0)} of the last "
                f"{_WINDOW // 3600} h in which the set-point did not call for {kind}; check for a valve that does not "
                "close, for manual operation, and whether the set-point channel is the one in force"
            )
            findings.append(Finding(HEAT_WITHOUT_CALL, channel, sentence))
    return findings
