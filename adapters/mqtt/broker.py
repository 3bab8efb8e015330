"""Where a broker is, and how and as whom it is reached: the same for what the daemon publishes and for a source."""

import ssl
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field

from adapters.fields.logins import CertificatesConfig, LoginConfig
from adapters.fields.values import Port, PositiveDuration, Text, Timeout, choice, text

VERSIONS = ("5", "3.1.1")

PORT, TLS_PORT = 1883, 8883


def topic(value: object) -> str:
    """A topic without wildcards."""
    if problem := topic_problem(text(value)):
        raise ValueError(f'"{str(value)[:60]}" {problem}')
    return str(value)


Topic = Annotated[str, BeforeValidator(topic)]


class BrokerConfig(LoginConfig):
    """What every table that leads to a broker has."""

    host: Text | None = Field(default=None, description="name or address of the broker")
    port: Port | None = Field(default=None, description="TCP port; none: 1883, with `tls` 8883")
    version: Annotated[str, BeforeValidator(choice(*VERSIONS))] = Field(default="5", description="version of MQTT")
    client_id: Text | None = Field(
        default=None, description="name at the broker; none: `thermogate-<site>`, of a source with `-<name>`"
    )
    tls: CertificatesConfig | None = Field(
        default=None, description="TLS; none: no encryption, `{}`: the system's authorities"
    )
    keepalive: PositiveDuration = Field(default=30.0, description="silence after which the connection counts as lost")
    timeout: Timeout = Field(default=5.0, description="time limit for each answer")

    def called(self, client_id: str) -> Self:
        """This broker, to which we are `client_id` unless the table says otherwise."""
        return self if self.client_id else self.model_copy(update={"client_id": client_id})

    @property
    def tcp_port(self) -> int:
        return self.port or (PORT if self.tls is None else TLS_PORT)

    @property
    def place(self) -> str:
        host = self.host or ""
        return f"{'mqtt' if self.tls is None else 'mqtts'}://{f'[{host}]' if ':' in host else host}:{self.tcp_port}"

    def problems(self) -> Iterator[str]:
        if find_spec("paho") is None:
            yield "MQTT needs the package paho-mqtt; install it with pip install 'thermogate[mqtt]'"
        yield from super().problems()
        if self.tls is not None:
            yield from self.tls.problems()

    def context(self) -> ssl.SSLContext | None:
        """What TLS needs, read anew, where there are no `problems`; None without."""
        if self.tls is None:
            return None
        context = _Context(ssl.PROTOCOL_TLS_CLIENT)
        context.patience = self.timeout
        if self.tls.ca is None:
            context.load_default_certs()
        else:
            context.load_verify_locations(self.tls.ca)
        context.check_hostname = self.tls.verify_name
        if self.tls.certificate is not None and self.tls.private_key is not None:
            context.load_cert_chain(self.tls.certificate, self.tls.private_key, password="")
        return context


class _Context(ssl.SSLContext):
    """Shakes hands at once: the client library would wait long for an answer, and leave the socket open without."""

    patience = 5.0

    def wrap_socket(self, *arguments: Any, **settings: Any) -> ssl.SSLSocket:
        wrapped = super().wrap_socket(*arguments, **settings)
        try:
            wrapped.settimeout(self.patience)
            wrapped.do_handshake()
        except OSError:
            wrapped.close()
            raise
        return wrapped


def topic_problem(topic: str) -> str | None:
    """What is wrong with a topic, or None."""
    if not topic or "\0" in topic or len(topic.encode("utf-8", "surrogatepass")) > 65_535:
        return "is empty, too long or has a character that MQTT forbids"
    if any("\ud800" <= character <= "\udfff" for character in topic):
        return "is no UTF-8 text"
    if any(wildcard in topic for wildcard in "+#"):
        return "has a wildcard (+ or #); name one topic for each channel"
    return None
