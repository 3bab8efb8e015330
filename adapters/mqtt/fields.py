"""How a broker is reached, as it is written in the configuration: the same for what the daemon publishes and for a
source."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator

from adapters.credentials import Tls
from adapters.fields.logins import CertificatesConfig, LoginConfig
from adapters.fields.values import PositiveDuration, Text, Timeout, choice, text, whole
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

    host: Text | None = None
    port: Annotated[int, BeforeValidator(whole(1, 65535))] | None = None
    version: Annotated[str, BeforeValidator(choice(*VERSIONS))] = "5"
    client_id: Text | None = None
    tls: MqttTlsConfig | None = None
    keepalive: PositiveDuration = 30.0
    timeout: Timeout = 5.0

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
