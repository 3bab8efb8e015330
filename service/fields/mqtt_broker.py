"""How a broker is reached, as it is written in the configuration: the same for what the daemon publishes and for a
source."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import BaseModel, BeforeValidator, model_validator

from adapters.credentials import Tls
from adapters.mqtt.broker import VERSIONS, Broker, topic_problem
from service.fields.tables import TABLE
from service.fields.values import FilePath, Flag, PositiveDuration, Text, Timeout, choice, text, whole

PORT, TLS_PORT = 1883, 8883


def topic(value: object) -> str:
    """A topic without wildcards."""
    if problem := topic_problem(text(value)):
        raise ValueError(f'"{str(value)[:60]}" {problem}')
    return str(value)


Topic = Annotated[str, BeforeValidator(topic)]


class MqttTlsConfig(BaseModel):
    """tls of a broker: certificates, as files in PEM; an empty table trusts the authorities of the system."""

    model_config = TABLE

    ca: FilePath | None = None
    certificate: FilePath | None = None
    private_key: FilePath | None = None
    verify_name: Flag = True

    @model_validator(mode="after")
    def _paired(self) -> Self:
        if (self.certificate is None) != (self.private_key is None):
            raise ValueError("certificate and private_key belong together; give both, or neither")
        return self


class BrokerConfig(BaseModel):
    """What every table that leads to a broker has."""

    model_config = TABLE

    host: Text | None = None
    port: Annotated[int, BeforeValidator(whole(1, 65535))] | None = None
    version: Annotated[str, BeforeValidator(choice(*VERSIONS))] = "5"
    client_id: Text | None = None
    user: Text | None = None
    password_file: FilePath | None = None
    password_env: Text | None = None
    tls: MqttTlsConfig | None = None
    keepalive: PositiveDuration = 30.0
    timeout: Timeout = 5.0

    @model_validator(mode="after")
    def _known(self) -> Self:
        passwords = [self.password_file, self.password_env]
        if (self.user is None) != (passwords.count(None) == 2) or None not in passwords:
            raise ValueError("user goes with the password's place: give user and one of password_file and password_env")
        return self

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
