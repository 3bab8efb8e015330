"""Sources of kind "mqtt": what devices publish on a broker."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, model_validator

from adapters.messages.points import Dating
from adapters.mqtt.source import TIMES, Intake, MqttSource
from service.fields.mqtt_broker import BrokerConfig, Topic
from service.fields.values import Duration, Text, choice, context, whole
from service.sources.channel import Binding, SourceKind
from service.sources.messages import MessageChannelConfig, MessagesConfig, different, message_channel


class MqttSourceConfig(BrokerConfig, MessagesConfig):
    """[sources.<name>] of kind "mqtt": what devices publish, over a connection of its own."""

    kind: Literal["mqtt"] = "mqtt"
    host: Text = Field(description='the broker, such as "homeassistant.local" or "192.168.1.10"')
    session: Duration = 3600.0
    qos: Annotated[int, BeforeValidator(whole(0, 1))] | None = None
    status_topic: Topic | None = None
    times: Annotated[tuple[Annotated[str, BeforeValidator(choice(*TIMES))], ...], AfterValidator(different)] = Field(
        default=TIMES, min_length=1, description=f"a list of {', '.join(TIMES)} in the order of preference"
    )

    @model_validator(mode="before")
    @classmethod
    def _with_a_client_id(cls, table: Any, info: ValidationInfo) -> Any:
        site = context(info).get("site")
        if not isinstance(table, dict) or "client_id" in table or site is None:
            return table
        return table | {"client_id": f"thermogate-{site}-{context(info).get('source', 'source')}"}

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""
        return f"{self.broker('').place}, MQTT {self.version}"


class MqttChannelConfig(MessageChannelConfig):
    """A channel of an MQTT source."""

    topic: Topic = Field(description='the topic that it is published on, such as "zigbee2mqtt/living"')

    @property
    def place(self) -> str:
        """Its topic."""
        return self.topic


def _build(name: str, table: MqttSourceConfig, bindings: Sequence[Binding]) -> MqttSource:
    return MqttSource(
        name,
        table.broker(f"thermogate-{name}"),
        [message_channel(binding) for binding in bindings],
        Intake(
            Dating(table.times, table.max_ahead),
            table.session,
            table.qos,
            table.queue,
            table.longest_stretch,
            table.status_topic,
        ),
    )


def _rebind(source: MqttSource, table: MqttSourceConfig, bindings: Sequence[Binding]) -> None:
    source.rebind([message_channel(binding) for binding in bindings])


KIND = SourceKind("mqtt", MqttSourceConfig, MqttChannelConfig, True, 'topic = "..."', _build, _rebind)
