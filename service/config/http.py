"""[http] as it is written in the configuration: where REST is served, to whom, and how much of it."""

import ipaddress
import re
from typing import Annotated, Self

from pydantic import BeforeValidator, Field, model_validator

from adapters.fields.tables import Table
from adapters.fields.values import Count, FilePath, Flag, PositiveDuration, is_loopback, text, whole
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
Streams = Annotated[int, BeforeValidator(whole(0, 100_000))]


class LimitsConfig(Table):
    """[http.limits]: what clients may take. Sizes are bytes."""

    connections: Count = Field(default=256, description="connections at a time")
    connections_per_client: Count = Field(default=32, description="of one address (IPv6: one /64)")
    streams: Streams = Field(default=64, description="event streams at a time")
    streams_per_client: Streams = Field(default=8, description="of one key, or of one address without keys")
    body: Annotated[int, BeforeValidator(whole(1024, 1_000_000_000))] = Field(
        default=1_048_576, description="bytes in the body of a request; more: 413"
    )
    post_rate: Annotated[int, BeforeValidator(whole(1000, 1_000_000_000))] = Field(
        default=1_000_000, description="bytes/s of readings, unpacked, of one key, a minute's worth at once; more: 429"
    )
    url: Annotated[int, BeforeValidator(whole(256, 65_536))] = Field(
        default=8192, description="bytes in path and query; more: 414"
    )
    headers: Annotated[int, BeforeValidator(whole(1024, 262_144))] = Field(
        default=16_384, description="bytes in all headers; more: 431"
    )
    unsent: Annotated[int, BeforeValidator(whole(1_048_576, 100_000_000_000))] = Field(
        default=67_108_864, description="bytes of answers that wait for their clients"
    )
    receive_timeout: PositiveDuration = Field(default=10.0, description="time for a request to arrive; then 408")
    send_timeout: PositiveDuration = Field(default=30.0, description="time for 64 KiB of an answer to be taken")
    idle_timeout: PositiveDuration = Field(default=15.0, description="time without a request")


class HttpConfig(Table):
    """[http]: where REST is served; port 0 is any free one."""

    host: Host = Field(
        default="127.0.0.1", description="address to serve on; any but loopback needs encryption and a key"
    )
    port: Port = Field(default=8080, description="TCP port; 0: any free one")
    socket: FilePath | None = Field(default=None, description="UNIX socket in place of `host` and `port`")
    keys_file: FilePath | None = Field(
        default=None, description="file of the API keys; none: `keys.json` in `state_dir`"
    )
    certificate: FilePath | None = Field(
        default=None, description="the server's certificate and those that signed it, PEM"
    )
    private_key: FilePath | None = Field(
        default=None, description="its key, PEM, not encrypted, for the daemon's account only"
    )
    client_ca: FilePath | None = Field(default=None, description="authorities that clients need a certificate of, PEM")
    behind_tls_proxy: Flag = Field(
        default=False, description="a proxy in front encrypts and is the only way here; every request needs a key"
    )
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
