"""What every kind of source declares: its table, the table of its channels, and how it is built from them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf
from pkgutil import resolve_name
from typing import Any, ClassVar, NamedTuple, Self

from pydantic import ConfigDict, Field

from adapters.edge import Edge
from adapters.fields.tables import Table
from adapters.fields.values import Duration, NonZero, Number, Pace, Positive, PositiveDuration, Range, Share, Text
from adapters.reading import Source
from adapters.timestamps import Array
from adapters.units import ENERGIES, conversion, default_valid_range


class ForecastConfig(Table):
    """`forecast` of a channel: what a [weather.<name>] table foresees of it."""

    source: Text = Field(description="the name of the [weather.<name>] table")
    series: Text = Field(description='the name of the series there, such as "temperature_2m"')
    unit: Text | None = Field(default=None, description="unit of the series; one that states another is not used")


class ChannelConfig(Table):
    """What a channel says whatever its source is: network value = raw value * scale + offset, converted from `unit`."""

    source: Text = Field(description="the name of the [sources.<name>] table that delivers it")
    unit: Text = Field(description='the unit of the value after scale and offset, such as "degC" or "kW"')
    scale: NonZero = Field(default=1.0, description="factor of the raw value")
    offset: Number = Field(default=0.0, description="added after `scale`")
    nominal: Positive | None = Field(
        default=None, description="power in `%`: the power at 100 %, in the network's unit"
    )
    rollover: Positive | None = Field(default=None, description="counters: raw value at which it starts again from 0")
    aggregate: Text = Field(
        default="mean", description="how the readings of an interval become one value; of power `first` by default"
    )
    valid: Range | None = Field(
        default=None, description="two numbers, the smallest and the largest believable value in the network's unit"
    )
    max_age: Duration | None = Field(default=None, description="inputs: how long a missing value is held")
    installed: Positive | None = Field(default=None, description="power: the largest that can be planned")
    share: Share | None = Field(
        default=None, description="meter of several zones: a name for it, the same in each, or the zone's likely share"
    )
    forecast: ForecastConfig | None = Field(default=None, description="inputs: the weather forecast for it")

    @property
    def address(self) -> str:
        """Where the value is found at its source, in the operator's words."""
        return ""

    @property
    def switched(self) -> bool:
        """Whether its value is known to be either on or off."""
        return False

    def foreknown(self, unit: str) -> Callable[[Array], Array] | None:
        """Its values in `unit` at times (h,) [UTC s], past or to come; None where somebody has to deliver them."""
        return None

    @property
    def known_values(self) -> Sequence[float]:
        """All raw values that it can come to have, where `foreknown` knows them, otherwise none."""
        return ()

    @property
    def stated_unit(self) -> str | None:
        """The unit that a device may state of the raw value; None where `scale` and `offset` make it another one."""
        return self.unit if (self.scale, self.offset) == (1.0, 0.0) else None

    def edge(self, unit: str, rollover: float | None = None, usual: tuple[float, float] = (-inf, inf)) -> Edge:
        """How raw values become values in `unit`; a counter that does not say otherwise rolls over at `rollover`."""
        energy = self.unit in ENERGIES and self.unit != unit
        amounts = energy and self.aggregate == "energy"
        return Edge(
            self.scale,
            self.offset,
            conversion(self.unit, unit, self.nominal),
            (-inf, inf) if amounts else self.valid or default_valid_range(unit),
            counter=energy and not amounts,
            rollover=self.rollover or rollover,
            usual=usual,
        )

    def within(self, table: Any) -> Self:
        """This channel with every key of `table`, its source, that it does not have; ValueError if it is then wrong."""
        inherited = type(table).model_fields.keys() & type(self).model_fields.keys()
        return self.model_copy(update={name: getattr(table, name) for name in inherited if getattr(self, name) is None})


class UnboundChannel(ChannelConfig):
    """A channel whose source is not known: what depends on the kind of source is passed over."""

    model_config = ConfigDict(extra="ignore")


class WatchedChannelConfig(ChannelConfig):
    """A channel of a live source."""

    stuck_after: PositiveDuration | None = Field(
        default=None, description="a raw value unchanged for so long is uncertain, for twice as long refused"
    )


class Binding(NamedTuple):
    """What a source delivers to one channel: the id of its readings ("zone/channel"), the network's unit for it, and
    the range in which its values usually lie."""

    id: str
    channel: Any
    """The channel's table, of the model that belongs to the kind of source."""
    unit: str
    usual: tuple[float, float] = (-inf, inf)

    def edge(self, rollover: float | None = None) -> Edge:
        return self.channel.edge(self.unit, rollover, self.usual)

    def reads_like(self, other: Binding) -> bool:
        """Whether a source delivers the same readings to both; the rest of their tables is of no concern to it."""
        mine, theirs = ({key: value for key, value in one.channel if key not in _OF_THE_ZONE} for one in (self, other))
        return self.id == other.id and mine == theirs and self.edge() == other.edge()


_OF_THE_ZONE = {"aggregate", "max_age", "installed", "share", "forecast"}


class SourceConfig(Table):
    """[sources.<name>]: the table of a source; its subclasses are listed in `adapters.kinds`. `live`: it tells what is
    now, not what was. `connects`: it asks a device or a server. `example`: how a table of `channel` says where its
    value is found. `source`: its class, as module:class, imported when one is built."""

    live: ClassVar[bool]
    connects: ClassVar[bool] = True
    channel: ClassVar[type[ChannelConfig]]
    example: ClassVar[str]
    source: ClassVar[str]

    kind: str

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""
        raise NotImplementedError

    def build(self, name: str, bindings: Sequence[Binding]) -> Source:
        return resolve_name(self.source)(name, self, bindings)


class RecordedConfig(SourceConfig):
    live: ClassVar[bool] = False
    connects: ClassVar[bool] = False

    pace: Pace = Field(default=inf, description='multiple of real time; `"max"`: as fast as possible')


class LiveConfig(SourceConfig):
    live: ClassVar[bool] = True

    stuck_after: PositiveDuration | None = None
