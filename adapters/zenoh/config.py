"""The tables of kind "zenoh": what a building management system publishes."""

from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from adapters.fields.values import Duration, Text
from adapters.messages.config import TIMES, MessageChannelConfig, MessagesConfig, times_of
from adapters.zenoh.access import ANYBODY, collecting
from adapters.zenoh.connection import Mode, SessionConfig


class ZenohChannelConfig(MessageChannelConfig):
    """A channel of a Zenoh source."""

    noun: ClassVar = "key"

    key: Text = Field(description='the key expression that it is published on, such as "bms/room1/T_air"')


class ZenohSourceConfig(SessionConfig, MessagesConfig):
    """[sources.<name>] of kind "zenoh": what a building management system publishes, in a session of its own."""

    channel: ClassVar = ZenohChannelConfig
    example: ClassVar = 'key = "..."'
    source: ClassVar = "adapters.zenoh.source:ZenohSource"

    kind: Literal["zenoh"] = "zenoh"
    mode: Mode = Field(default="client", description="role of the session")
    writers: tuple[Text, ...] | None = Field(
        default=None, min_length=1, description='a list of user names and common names, such as ["bms-gateway"]'
    )
    times: times_of(*TIMES) = TIMES  # type: ignore[valid-type]
    recover: Duration = Field(default=0.0, description="age of missed samples asked of publishers that keep a cache")

    @model_validator(mode="after")
    def _reachable(self) -> Self:
        if not self.connect and not self.listen:
            raise ValueError('needs connect, such as connect = ["tcp/192.168.1.30:7447"], or listen')
        if self.mode == "client" and (self.listen or not self.connect):
            raise ValueError('mode "client" only connects; give connect and no listen, or mode "peer" or "router"')
        return self

    @model_validator(mode="after")
    def _written_by_somebody(self) -> Self:
        anybody = self.writers is not None and ANYBODY in self.writers
        if anybody and self.writers != (ANYBODY,):
            raise ValueError(f'writers: "{ANYBODY}" lets everyone put readings; remove it, or the names beside it')
        if self.listen and self.writers is None:
            raise ValueError(
                "listening lets others connect; say in writers, by user name or by the common name of their "
                f'certificate, who may put readings, or writers = ["{ANYBODY}"] for everyone who can connect'
            )
        nameless = [endpoint for endpoint in self.listen if not self.knows(endpoint)]
        if self.writers and not anybody and nameless:
            raise ValueError(
                f"writers: who connects to {nameless[0]} has no name; give users_file, or listen on tls with tls.ca, "
                "tls.certificate and tls.private_key and mutual = true"
            )
        return self

    @model_validator(mode="after")
    def _recoverable(self) -> Self:
        if self.recover and self.times[0] == "arrival":
            raise ValueError(
                'recover brings samples long after they were sent, which times must then not date by their "arrival"; '
                'put "payload" or "zenoh" first'
            )
        return self

    @property
    def access(self) -> dict[str, object]:
        """The access control by which `writers`, or whom we connect to, may tell us something."""
        return collecting(self.writers or (ANYBODY,), relaying=bool(self.listen))

    @property
    def described(self) -> str:
        listening = f"listening on {', '.join(self.listen)}" if self.listen else ""
        connecting = f"connecting to {', '.join(self.connect)}" if self.connect else ""
        return f"{self.mode} {' and '.join(filter(None, (connecting, listening)))}"
