"""What every kind of source and channel has in the configuration, and what a kind is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf
from typing import Any, NamedTuple, Protocol, Self

from pydantic import BaseModel, Field

from adapters.edge import Edge
from adapters.reading import Source
from adapters.units import ENERGIES, conversion, default_valid_range
from service.fields.tables import TABLE
from service.fields.values import Duration, NonZero, Number, Positive, Range, Text


class ForecastConfig(BaseModel):
    """`forecast` of a channel: what a [weather.<name>] table foresees of it."""

    model_config = TABLE

    source: Text = Field(description="the name of the [weather.<name>] table")
    series: Text = Field(description='the name of the series there, such as "temperature_2m"')
    unit: Text | None = None


class ChannelConfig(BaseModel):
    """What a channel says whatever its source is: network value = raw value * scale + offset, converted from `unit`.

    Every kind of source adds where the raw value is found there.
    """

    model_config = TABLE

    source: Text = Field(description="the name of the [sources.<name>] table that delivers it")
    unit: Text = Field(description='the unit of the value after scale and offset, such as "degC" or "kW"')
    scale: NonZero = 1.0
    offset: Number = 0.0
    nominal: Positive | None = None
    rollover: Positive | None = None
    aggregate: Text = "mean"
    valid: Range | None = Field(
        default=None, description="two numbers, the smallest and the largest believable value in the network's unit"
    )
    max_age: Duration | None = None
    installed: Positive | None = None
    forecast: ForecastConfig | None = None

    @property
    def address(self) -> str:
        """Where the value is found at its source, in the operator's words."""
        return ""

    @property
    def switched(self) -> bool:
        """Whether its value is known to be either on or off."""
        return False

    def within(self, table: Any) -> Self:
        """This channel with what it takes over from `table`, its source; ValueError with one sentence if it then
        cannot be read."""
        return self


class UnboundChannel(ChannelConfig):
    """A channel whose source is not known: what depends on the kind of source is passed over."""

    model_config = TABLE | {"extra": "ignore"}


class SourceConfig(Protocol):
    """What every table of a source has; a recorded one also has `pace`, the multiple of real time, and one that is
    polled `poll`, in s."""

    @property
    def kind(self) -> str:
        """Its kind's name."""

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""


class Binding(NamedTuple):
    """What a source delivers to one channel: the id of its readings ("zone/channel"), the network's unit for it, and
    the range in which its values usually lie."""

    id: str
    channel: Any
    """The channel's table, of the model that belongs to the kind of source."""
    unit: str
    usual: tuple[float, float] = (-inf, inf)


class SourceKind(NamedTuple):
    """A kind of source: its name in the configuration, the table that describes a source of it, the one that describes
    a channel, and how to build one from its name, table and bindings.

    A `live` source tells what is now, a recorded one what was. `example` is how a channel says where its value is
    found. `rebind` gives a live source that is at work other bindings.
    """

    name: str
    table: type[Any]
    channel: type[ChannelConfig]
    live: bool
    example: str
    build: Callable[[str, Any, Sequence[Binding]], Source]
    rebind: Callable[[Any, Any, Sequence[Binding]], None] | None = None


def edge_of(
    channel: ChannelConfig,
    unit: str,
    rollover: float | None = None,
    usual: tuple[float, float] = (-inf, inf),
) -> Edge:
    """How raw values of `channel` become values in the network's `unit`, which `usual`ly lie in a range; a counter that
    does not say otherwise starts again at `rollover`."""
    energy = channel.unit in ENERGIES and channel.unit != unit
    amounts = energy and channel.aggregate == "energy"
    return Edge(
        channel.scale,
        channel.offset,
        conversion(channel.unit, unit, channel.nominal),
        (-inf, inf) if amounts else channel.valid or default_valid_range(unit),
        counter=energy and not amounts,
        rollover=channel.rollover or rollover,
        usual=usual,
    )
