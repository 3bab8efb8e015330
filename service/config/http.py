"""[http] as it is written in the configuration: where REST is served, to whom, and how much of it."""

from __future__ import annotations

import ipaddress
import re
from typing import Annotated, Self

from pydantic import BaseModel, BeforeValidator, Field, model_validator

from adapters.fields.tables import TABLE
from adapters.fields.values import FilePath, Flag, PositiveDuration, is_loopback, text, whole
from adapters.fields.words import shown

_HOST_NAME = re.compile(r"(?!-)[A-Za-z0-9-]{1,63}(?:\.(?!-)[A-Za-z0-9-]{1,63})*")


def address(value: object) -> str:
    """An IP address, without the brackets of IPv6."""
    try:
        return str(ipaddress.ip_address(text(value).strip("[]")))
    except ValueError:
        raise ValueError(f'{shown(value)} is not an IP address; write one such as "192.168.1.20" or "::1"') from None


def host(value: object) -> str:
    """An IP address or the name of a machine, in lower case."""
    given = text(value).strip("[]").lower()
    try:
        return str(ipaddress.ip_address(given))
    except ValueError:
        if not _HOST_NAME.fullmatch(given) or len(given) > 253:
            raise ValueError(
                f'{shown(value)} is neither an IP address nor the name of a machine; write one such as "127.0.0.1" or '
                '"thermogate.example"'
            ) from None
        return given


Address = Annotated[str, BeforeValidator(address)]
Host = Annotated[str, BeforeValidator(host)]
Port = Annotated[int, BeforeValidator(whole(0, 65535))]


class LimitsConfig(BaseModel):
    """[http.limits]: what clients may take. Sizes are bytes."""

    model_config = TABLE

    connections: Annotated[int, BeforeValidator(whole(1, 100_000))] = 256
    connections_per_client: Annotated[int, BeforeValidator(whole(1, 100_000))] = 32
    streams: Annotated[int, BeforeValidator(whole(0, 100_000))] = 64
    streams_per_client: Annotated[int, BeforeValidator(whole(0, 100_000))] = 8
    body: Annotated[int, BeforeValidator(whole(1024, 1_000_000_000))] = 1_048_576
    url: Annotated[int, BeforeValidator(whole(256, 65_536))] = 8192
    headers: Annotated[int, BeforeValidator(whole(1024, 262_144))] = 16_384
    unsent: Annotated[int, BeforeValidator(whole(1_048_576, 100_000_000_000))] = 67_108_864
    receive_timeout: PositiveDuration = 10.0
    send_timeout: PositiveDuration = 30.0
    idle_timeout: PositiveDuration = 15.0


class HttpConfig(BaseModel):
    """[http]: where REST is served; port 0 is any free one."""

    model_config = TABLE

    host: Host = "127.0.0.1"
    port: Port = 8080
    socket: FilePath | None = None
    keys_file: FilePath | None = None
    certificate: FilePath | None = None
    private_key: FilePath | None = None
    client_ca: FilePath | None = None
    behind_tls_proxy: Flag = False
    trusted_proxies: tuple[Address, ...] = Field(
        default=("127.0.0.1", "::1"), description='a list of IP addresses, such as ["192.168.1.20"]'
    )
    allowed_hosts: tuple[Host, ...] = Field(default=(), description='a list of names, such as ["thermogate.example"]')
    limits: LimitsConfig = Field(default=LimitsConfig(), description="a table, such as connections = 256")

    @model_validator(mode="after")
    def _paired(self) -> Self:
        if (self.certificate is None) != (self.private_key is None):
            raise ValueError("certificate and private_key belong together; give both, or neither")
        if self.client_ca is not None and self.certificate is None:
            raise ValueError("client_ca asks clients for certificates, which needs certificate and private_key")
        return self

    @model_validator(mode="after")
    def _one_address(self) -> Self:
        if self.socket is not None and self.model_fields_set & {"host", "port"}:
            raise ValueError("socket takes the place of host and port; remove them, or remove socket")
        return self

    @model_validator(mode="after")
    def _encrypted(self) -> Self:
        if not (is_loopback(self.host) or self.certificate or self.behind_tls_proxy):
            raise ValueError(
                f"listening on {shown(self.host)} lets other machines in, which needs encryption: give certificate and "
                'private_key, or behind_tls_proxy = true where a proxy in front encrypts, or use host = "127.0.0.1"'
            )
        return self

    @property
    def exposed(self) -> bool:
        """Whether others than the accounts of this machine can ask, so that every request needs a key."""
        return self.behind_tls_proxy or not is_loopback(self.host)
