"""The tables of kinds "opcua" and "opcua-history": the values of OPC UA servers, as they are now and as they were."""

from collections.abc import Iterator
from importlib.util import find_spec
from typing import Annotated, ClassVar, Literal
from urllib.parse import urlsplit

from pydantic import BeforeValidator, Field

from adapters.channel import ChannelConfig, LiveConfig, WatchedChannelConfig
from adapters.errors import SourceConfigError
from adapters.fields.durations import format_duration
from adapters.fields.logins import LoginConfig
from adapters.fields.tables import Table
from adapters.fields.times import written_time
from adapters.fields.values import FilePath, Flag, PositiveDuration, Timeout, check, choice, matching, text
from adapters.fields.words import shown
from adapters.opcua.identity import identity
from adapters.series.config import HistoryConfig

PORT = 4840
POLICIES = ("Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss")
MODES = ("sign", "encrypt")

_NODE = matching(r"(ns=\d{1,5};|nsu=[^;]+;)?(i=\d{1,10}|s=.+|g=[0-9a-fA-F-]{36}|b=[A-Za-z0-9+/]+=*)")
"""The id of a node, as OPC UA writes it (part 6, 5.3.1.10)."""


def server_url(value: object) -> str:
    """The address of a server, with its port."""
    try:
        parts = urlsplit(text(value))
        if parts.scheme == "opc.tcp" and parts.hostname and parts.username is None:
            host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
            return f"opc.tcp://{host}:{parts.port or PORT}{parts.path}"
    except ValueError:
        pass
    raise ValueError(f'must be an address such as "opc.tcp://192.168.1.10:{PORT}", not {shown(value)}')


node_id = check(
    lambda value: _NODE(text(value)),
    'must be the id of a node such as "ns=2;s=Room.Temperature", "ns=2;i=1001" or '
    '"nsu=urn:plant;s=Room.Temperature", not {}',
)


class NodeConfig(ChannelConfig):
    """A channel whose value a node has."""

    node: Annotated[str, BeforeValidator(node_id)] = Field(
        description='the id of the node whose value it is, such as "ns=2;s=Room.Temperature"'
    )

    @property
    def address(self) -> str:
        return self.node


class SecurityConfig(Table):
    """security of a server."""

    mode: Annotated[str, BeforeValidator(choice(*MODES))] = Field(
        default="encrypt", description="sign the messages, or sign and encrypt them"
    )
    policy: Annotated[str, BeforeValidator(choice(*POLICIES))] = Field(
        default=POLICIES[0], description="security policy of the server"
    )
    certificate: FilePath = Field(
        description="the certificate of this client, PEM or DER, with a URI as subject alternative name"
    )
    private_key: FilePath = Field(description="the key of `certificate`, PEM or DER, without a password")
    server_certificate: FilePath = Field(
        description="the certificate of the server, PEM or DER; no other one is trusted"
    )


class ServerConfig(LoginConfig):
    """What every table that leads to a server has."""

    url: Annotated[str, BeforeValidator(server_url)] = Field(
        description=f'the address of the server, such as "opc.tcp://192.168.1.10:{PORT}"'
    )
    security: SecurityConfig | None = Field(default=None, description="security of the channel; none: no security")
    timeout: Timeout = Field(default=5.0, description="time limit for a connection and each answer")

    def problems(self) -> Iterator[str]:
        if find_spec("asyncua") is None:
            yield "OPC UA needs asyncua; install it with: pip install 'thermogate[opcua]'"
        yield from super().problems()
        if self.security is not None:
            try:
                identity(self.security.certificate, self.security.private_key, self.security.server_certificate)
            except SourceConfigError as error:
                yield str(error)


class OpcuaChannelConfig(NodeConfig, WatchedChannelConfig):
    """A channel of an OPC UA source; what is None is taken over from the source."""

    subscribe: Flag | None = Field(default=None, description="allow a subscription; false: poll")


class OpcuaConfig(ServerConfig, LiveConfig):
    """[sources.<name>] of kind "opcua": the nodes of a server, subscribed to and polled, read only."""

    channel: ClassVar = OpcuaChannelConfig
    example: ClassVar = 'node = "ns=2;s=..."'
    source: ClassVar = "adapters.opcua.source:OpcuaSource"

    kind: Literal["opcua"] = "opcua"
    poll: PositiveDuration = Field(default=10.0, description="time between two readings of a channel")
    subscribe: Flag = True

    @property
    def described(self) -> str:
        return f"{self.url}, polled every {format_duration(self.poll)}"


class OpcuaHistoryConfig(ServerConfig, HistoryConfig):
    """[sources.<name>] of kind "opcua-history": what a server has recorded of its nodes (Historical Access)."""

    channel: ClassVar = NodeConfig
    asked: ClassVar = "adapters.opcua.history:History"
    example: ClassVar = 'node = "ns=2;s=..."'

    kind: Literal["opcua-history"] = "opcua-history"
    hold: PositiveDuration = Field(
        default=3600.0, description="how long a recorded value counts where no other one follows"
    )

    @property
    def described(self) -> str:
        return f"the history of {self.url}, from {written_time(self.begin)}"
