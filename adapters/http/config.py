"""The tables of kind "http": values that clients such as Telegraf post to the daemon."""

from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from adapters.channel import LiveConfig, WatchedChannelConfig
from adapters.fields.values import Duration, PositiveDuration, Text


class HttpChannelConfig(WatchedChannelConfig):
    """A channel that is posted to. Without more, it is called by its id: zone/channel, or in line protocol the zone as
    the measurement and the channel as the field."""

    name: Text | None = Field(default=None, description="JSON and SenML: its name besides the id")
    measurement: Text | None = Field(default=None, description="line protocol: the measurement; none: the zone")
    field: Text | None = Field(default=None, description="line protocol: the field; none: the channel, or `value`")
    tags: Mapping[Text, Text] = Field(default={}, description='a table of texts, such as { topic = "room1" }')

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.measurement is None and (self.field is not None or self.tags):
            raise ValueError("field and tags belong to a measurement; give measurement as well, or remove them")
        return self

    @property
    def address(self) -> str:
        if self.measurement is None:
            return self.name or "values posted for it"
        tags = "".join(f",{key}={value}" for key, value in self.tags.items())
        return " ".join(filter(None, (self.name, f"{self.measurement}{tags}", self.field or "value")))


class HttpSourceConfig(LiveConfig):
    """[sources.<name>] of kind "http": values that are posted to this daemon."""

    channel: ClassVar = HttpChannelConfig
    example: ClassVar = 'name = "..."'
    source: ClassVar = "adapters.http.source:HttpSource"

    kind: Literal["http"] = "http"
    max_ahead: Duration = Field(default=10.0, description="how far a time may be ahead of this machine's clock")
    longest_stretch: PositiveDuration = Field(
        default=900.0, description="counters: readings further apart give no power"
    )

    @property
    def described(self) -> str:
        return "values posted to /readings and /zones/ZONE/readings, with an API key of the scope write"
