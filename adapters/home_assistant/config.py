"""The tables of kind "home-assistant": the history in the database of its recorder."""

from typing import Annotated, ClassVar, Literal

from pydantic import BeforeValidator, Field

from adapters.channel import ChannelConfig, RecordedConfig
from adapters.fields.values import FilePath, Text, choice


class HomeAssistantChannelConfig(ChannelConfig):
    """A channel of Home Assistant's history: the raw value is the state of an entity, or an attribute of it."""

    entity: Text = Field(description='the id of the entity, such as "sensor.living_temperature"')
    attribute: Text | None = Field(
        default=None, description='attribute in place of the state, such as `"current_temperature"`'
    )

    @property
    def address(self) -> str:
        return self.entity if self.attribute is None else f"{self.entity}, attribute {self.attribute}"


class HomeAssistantConfig(RecordedConfig):
    """[sources.<name>] of kind "home-assistant": the database of Home Assistant's recorder."""

    channel: ClassVar = HomeAssistantChannelConfig
    example: ClassVar = 'entity = "sensor...."'
    source: ClassVar = "adapters.series.source:SeriesSource"
    asked: ClassVar = "adapters.home_assistant.database:Recorder"
    step: ClassVar = 60.0
    """s from one reading of a value that holds to the next."""

    kind: Literal["home-assistant"] = "home-assistant"
    file: FilePath = Field(description='the database, such as "home-assistant_v2.db"')
    data: Annotated[str, BeforeValidator(choice("states", "statistics"))] = Field(
        default="states", description="every state, kept for days; or hourly means, kept for ever"
    )

    @property
    def described(self) -> str:
        return f"the {self.data} in {self.file.name}"
