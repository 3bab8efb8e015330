"""How a broker is reached, as it is written in the configuration: the same for what the daemon publishes and for a
source."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, Field

from adapters.credentials import Tls
from adapters.fields.logins import CertificatesConfig, LoginConfig
from adapters.fields.values import Port, PositiveDuration, Text, Timeout, choice, text
from adapters.mqtt.broker import VERSIONS, Broker, topic_problem

PORT, TLS_PORT = 1883, 8883


def topic(value: object) -> str:
    """A topic without wildcards."""
    if problem := topic_problem(text(value)):
        raise ValueError(f'"{str(value)[:60]}" {problem}')
    return str(value)


Topic = Annotated[str, BeforeValidator(topic)]


class MqttTlsConfig(CertificatesConfig):
    """tls of a broker; an empty table trusts the authorities of the system."""


class BrokerConfig(LoginConfig):
    """What every table that leads to a broker has."""

    host: Text | None = Field(default=None, description="name or address of the broker")
    port: Port | None = Field(default=None, description="TCP port; none: 1883, with `tls` 8883")
    version: Annotated[str, BeforeValidator(choice(*VERSIONS))] = Field(default="5", description="version of MQTT")
    client_id: Text | None = Field(
        default=None, description="name at the broker; none: `thermogate-<site>`, of a source with `-<name>`"
    )
    tls: MqttTlsConfig | None = Field(
        default=None, description="TLS; none: no encryption, `{}`: the system's authorities"
    )
    keepalive: PositiveDuration = Field(default=30.0, description="silence after which the connection counts as lost")
    timeout: Timeout = Field(default=5.0, description="time limit for each answer")

    def broker(self, client_id: str) -> Broker:
        """The broker, to which we are `client_id` unless the table says otherwise."""
        return Broker(
            self.host or "",
            self.port or (PORT if self.tls is None else TLS_PORT),
            self.version,
            self.client_id or client_id,
            self.user,
            self.password_file,
            self.password_env,
            None if self.tls is None else Tls(**dict(self.tls)),
            self.keepalive,
            self.timeout,
        )
