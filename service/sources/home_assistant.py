"""Sources of kind "home-assistant": the history in the database of its recorder."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, Field

from adapters.home_assistant.database import Entity
from adapters.home_assistant.source import RecorderChannel, RecorderSource
from service.fields.tables import TABLE
from service.fields.values import FilePath, Pace, Text, choice
from service.sources.channel import Binding, ChannelConfig, SourceKind, edge_of


class HomeAssistantConfig(BaseModel):
    """[sources.<name>] of kind "home-assistant": the database of Home Assistant's recorder."""

    model_config = TABLE

    kind: Literal["home-assistant"] = "home-assistant"
    file: FilePath = Field(description='the database, such as "home-assistant_v2.db"')
    data: Annotated[str, BeforeValidator(choice("states", "statistics"))] = "states"
    pace: Pace = float("inf")

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""
        return f"the {self.data} in {self.file.name}"


class HomeAssistantChannelConfig(ChannelConfig):
    """A channel of Home Assistant's history: the raw value is the state of an entity, or an attribute of it."""

    entity: Text = Field(description='the id of the entity, such as "sensor.living_temperature"')
    attribute: Text | None = None

    @property
    def address(self) -> str:
        """The entity."""
        return str(Entity(self.entity, self.attribute))


def _build(name: str, table: HomeAssistantConfig, bindings: Sequence[Binding]) -> RecorderSource:
    channels = [
        RecorderChannel(
            binding.id,
            Entity(binding.channel.entity, binding.channel.attribute),
            binding.channel.unit if (binding.channel.scale, binding.channel.offset) == (1.0, 0.0) else "",
            edge_of(binding.channel, binding.unit),
        )
        for binding in bindings
    ]
    return RecorderSource(name, table.file, channels, table.data, None if table.pace == inf else table.pace)


KIND = SourceKind(
    "home-assistant", HomeAssistantConfig, HomeAssistantChannelConfig, False, 'entity = "sensor...."', _build
)
