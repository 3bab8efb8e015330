"""Where the values of a channel usually lie, by what it measures: for a person who connects a plant."""

from math import inf

from adapters.channel import ChannelConfig
from adapters.units import default_valid_range
from estimator.network.network import Network
from service.zone.alignment import SETPOINT, unit_of

Span = tuple[float, float]

_ROOM, _OUTDOORS, _NEIGHBOUR = (5.0, 40.0), (-40.0, 50.0), (0.0, 45.0)  # degC
_HEATING = (-10e3, 10e3)  # W of one zone
_SUN = (-20.0, 1400.0)  # W/m2
_ANYWHERE = (-inf, inf)


def usual(network: Network, name: str, channel: ChannelConfig) -> Span:
    """The range, in the network's unit, in which channel `name` of a zone usually lies; any where `valid` or a share is
    given."""
    unit = unit_of(network, name)
    if channel.valid not in (None, default_valid_range(unit)) or name in network.shares:
        return _ANYWHERE
    if unit == "degC":
        if name in network.measured or name == SETPOINT:
            return _ROOM
        return _NEIGHBOUR if name.startswith("T_adj") else _OUTDOORS
    return {"W": _HEATING, "W/m2": _SUN}.get(unit, _ANYWHERE)
