"""The tables of kind "mqtt": what devices publish on a broker."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from adapters.fields.values import Duration, Text, context, whole
from adapters.messages.config import MessageChannelConfig, MessagesConfig, times_of
from adapters.mqtt.broker import BrokerConfig, Topic

TIMES = ("payload", "arrival")


class MqttChannelConfig(MessageChannelConfig):
    """A channel of an MQTT source."""

    noun: ClassVar = "topic"

    topic: Topic = Field(description='the topic that it is published on, such as "zigbee2mqtt/living"')


class MqttSourceConfig(BrokerConfig, MessagesConfig):
    """[sources.<name>] of kind "mqtt": what devices publish, over a connection of its own."""

    channel: ClassVar = MqttChannelConfig
    example: ClassVar = 'topic = "..."'
    source: ClassVar = "adapters.mqtt.source:MqttSource"

    kind: Literal["mqtt"] = "mqtt"
    host: Text = Field(description='the broker, such as "homeassistant.local" or "192.168.1.10"')
    session: Duration = Field(
        default=3600.0, description="how long the broker keeps subscriptions and their messages without us; 0: not"
    )
    qos: Annotated[int, BeforeValidator(whole(0, 1))] | None = Field(
        default=None, description="quality of service; none: 1 for payloads with a time, else 0"
    )
    status_topic: Topic | None = Field(default=None, description="topic of `online` and, as last will, `offline`")
    times: times_of(*TIMES) = TIMES  # type: ignore[valid-type]

    @model_validator(mode="before")
    @classmethod
    def _with_a_client_id(cls, table: Any, info: ValidationInfo) -> Any:
        site = context(info).get("site")
        if not isinstance(table, dict) or "client_id" in table or site is None:
            return table
        return table | {"client_id": f"thermogate-{site}-{context(info).get('source', 'source')}"}

    @property
    def described(self) -> str:
        return f"{self.place}, MQTT {self.version}"
