"""Sources of kind "http": values that clients such as Telegraf post to the daemon."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, Self

from pydantic import BaseModel, Field, model_validator

from adapters.http.source import HttpChannel, HttpSource
from service.fields.tables import TABLE
from service.fields.values import Duration, PositiveDuration, Text
from service.sources.channel import Binding, ChannelConfig, SourceKind, edge_of


class HttpSourceConfig(BaseModel):
    """[sources.<name>] of kind "http": values that are posted to this daemon."""

    model_config = TABLE

    kind: Literal["http"] = "http"
    max_ahead: Duration = 10.0
    longest_stretch: PositiveDuration = 900.0
    stuck_after: PositiveDuration | None = None

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""
        return "values posted to /readings and /zones/ZONE/readings, with an API key of the scope write"


class HttpChannelConfig(ChannelConfig):
    """A channel that is posted to. Without more, it is called by its id: zone/channel, or in line protocol the zone as
    the measurement and the channel as the field."""

    name: Text | None = None
    measurement: Text | None = None
    field: Text | None = None
    tags: Mapping[Text, Text] = Field(default={}, description='a table of texts, such as { topic = "room1" }')
    stuck_after: PositiveDuration | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.measurement is None and (self.field is not None or self.tags):
            raise ValueError("field and tags belong to a measurement; give measurement as well, or remove them")
        return self

    @property
    def address(self) -> str:
        """Name, measurement, tags and field, as far as they are given."""
        if self.measurement is None:
            return self.name or "values posted for it"
        tags = "".join(f",{key}={value}" for key, value in self.tags.items())
        return " ".join(filter(None, (self.name, f"{self.measurement}{tags}", self.field or "value")))

    def within(self, table: HttpSourceConfig) -> Self:
        """With what the source says for all of its channels."""
        return self.model_copy(update={"stuck_after": self.stuck_after or table.stuck_after})


def _build(name: str, table: HttpSourceConfig, bindings: Sequence[Binding]) -> HttpSource:
    return HttpSource(name, _channels(bindings), table.max_ahead, table.longest_stretch)


def _rebind(source: HttpSource, table: Any, bindings: Sequence[Binding]) -> None:
    source.rebind(_channels(bindings))


def _channels(bindings: Sequence[Binding]) -> list[HttpChannel]:
    return [_channel(binding.id, binding.channel, binding.unit) for binding in bindings]


def _channel(id: str, channel: HttpChannelConfig, unit: str) -> HttpChannel:
    zone, name = id.split("/", 1)
    # What a client states is the unit of its own number, before scale and offset.
    untouched = channel.scale == 1.0 and channel.offset == 0.0
    return HttpChannel(
        id,
        channel.name,
        channel.measurement or zone,
        channel.field or (name if channel.measurement is None else "value"),
        channel.tags,
        channel.unit if untouched else None,
        edge_of(channel, unit),
        channel.stuck_after,
    )


KIND = SourceKind("http", HttpSourceConfig, HttpChannelConfig, True, 'name = "..."', _build, _rebind)
