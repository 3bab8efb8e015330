"""Sources of kind "zenoh": what a building management system publishes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self
from zoneinfo import ZoneInfo

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from adapters.payload.json_pointer import parse
from adapters.payload.payload import FORMATS, PayloadFormat, quality_word
from adapters.payload.times import TIME_FORMATS
from adapters.zenoh.access import ANYBODY, collecting
from adapters.zenoh.connection import Connection
from adapters.zenoh.points import TIMES, Dating, ZenohChannel
from adapters.zenoh.source import Intake, ZenohSource
from service.fields.values import Duration, PositiveDuration, Text, TimeZone, choice, whole
from service.fields.words import shown
from service.fields.zenoh_session import Mode, SessionConfig
from service.sources.channel import Binding, ChannelConfig, SourceKind, edge_of

_INHERITED = ("format", "time_format", "time_zone", "good", "uncertain", "stuck_after")
_POINTERS = {"plain": (), "json": ("value", "time", "quality"), "senml": ("quality",)}
"""Which pointers a format has."""


def pointer(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError(f'must be a JSON pointer in quotes, such as "/present/value", not {shown(value)}')
    parse(value)
    return value


def word(value: object) -> str:
    if not isinstance(value, str | int | float):
        raise ValueError(f'must be a text, a number, true or false, such as "good" or 192, not {shown(value)}')
    return quality_word(value)


def different(times: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(times)) < len(times):
        raise ValueError(f"{shown(times)} names the same time twice")
    return times


Pointer = Annotated[str, BeforeValidator(pointer)]
Words = tuple[Annotated[str, BeforeValidator(word)], ...]
Format = Annotated[str, BeforeValidator(choice(*FORMATS))]
TimeFormat = Annotated[str, BeforeValidator(choice(*TIME_FORMATS))]
_WORDS = 'a list of what stands for it, such as ["good", 192]'


class ZenohSourceConfig(SessionConfig):
    """[sources.<name>] of kind "zenoh": what a building management system publishes, in a session of its own."""

    kind: Literal["zenoh"] = "zenoh"
    mode: Mode = "client"
    writers: tuple[Text, ...] | None = Field(
        default=None, min_length=1, description='a list of user names and common names, such as ["bms-gateway"]'
    )
    times: Annotated[tuple[Annotated[str, BeforeValidator(choice(*TIMES))], ...], AfterValidator(different)] = Field(
        default=TIMES, min_length=1, description=f"a list of {', '.join(TIMES)} in the order of preference"
    )
    max_ahead: Duration = 10.0
    recover: Duration = 0.0
    queue: Annotated[int, BeforeValidator(whole(1, 100_000))] = 1000
    longest_stretch: PositiveDuration = 900.0
    format: Format = "plain"
    value: Pointer = "/value"
    time: Pointer | None = None
    quality: Pointer | None = None
    time_format: TimeFormat = "iso8601"
    time_zone: TimeZone | None = None
    good: Words = Field(default=("good",), description=_WORDS)
    uncertain: Words = Field(default=("uncertain",), description=_WORDS)
    stuck_after: PositiveDuration | None = None

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
    def connection(self) -> Connection:
        """The session in which `writers`, or whom we connect to, may tell us something."""
        return self.session(collecting(self.writers or (ANYBODY,), relaying=bool(self.listen)))

    @property
    def described(self) -> str:
        """What it reads, for the summary of a check."""
        listening = f"listening on {', '.join(self.listen)}" if self.listen else ""
        connecting = f"connecting to {', '.join(self.connect)}" if self.connect else ""
        return f"{self.mode} {' and '.join(filter(None, (connecting, listening)))}"


class ZenohChannelConfig(ChannelConfig):
    """A channel of a Zenoh source; what is None is taken over from the source."""

    key: Text = Field(description='the key expression that it is published on, such as "bms/room1/T_air"')
    format: Format | None = None
    value: Pointer | None = None
    time: Pointer | None = None
    quality: Pointer | None = None
    record: Text | None = None
    time_format: TimeFormat | None = None
    time_zone: TimeZone | None = None
    good: Words | None = Field(default=None, description=_WORDS)
    uncertain: Words | None = Field(default=None, description=_WORDS)
    stuck_after: PositiveDuration | None = None

    @property
    def address(self) -> str:
        """Key and format."""
        return " ".join(filter(None, (self.key, self.format, self.value, self.record)))

    @property
    def payload_format(self) -> PayloadFormat:
        """How its payloads are written; of a channel that is `within` its source."""
        # What SenML states is the unit of its own number, before scale and offset.
        untouched = self.scale == 1.0 and self.offset == 0.0
        return PayloadFormat(
            str(self.format),
            parse(self.value or ""),
            None if self.time is None else parse(self.time),
            None if self.quality is None else parse(self.quality),
            str(self.time_format),
            None if self.time_zone is None else ZoneInfo(self.time_zone),
            frozenset(self.good or ()),
            frozenset(self.uncertain or ()),
            self.record,
            self.unit if untouched else None,
        )

    def within(self, table: ZenohSourceConfig) -> Self:
        """With what the source says for all of its channels; ValueError where the result cannot be read."""
        form = self.format or table.format
        pointers = _POINTERS[form]
        for name in ("value", "time", "quality"):
            if getattr(self, name) is not None and name not in pointers:
                raise ValueError(f'format "{form}" has no {name}; remove it, or use format "json"')
        if self.record is not None and form != "senml":
            raise ValueError(f'record is for format "senml", not "{form}"')
        taken: dict[str, Any] = {
            name: getattr(table, name) for name in (*_INHERITED, *pointers) if getattr(self, name) is None
        }
        return self.model_copy(update=taken)


def _build(name: str, table: ZenohSourceConfig, bindings: Sequence[Binding]) -> ZenohSource:
    return ZenohSource(
        name,
        table.connection,
        [_channel(binding.id, binding.channel, binding.unit) for binding in bindings],
        Intake(Dating(table.times, table.max_ahead), table.recover, table.queue, table.longest_stretch),
    )


def _rebind(source: ZenohSource, table: ZenohSourceConfig, bindings: Sequence[Binding]) -> None:
    source.rebind([_channel(binding.id, binding.channel, binding.unit) for binding in bindings])


def _channel(id: str, channel: ZenohChannelConfig, unit: str) -> ZenohChannel:
    return ZenohChannel(id, channel.key, channel.payload_format, edge_of(channel, unit), channel.stuck_after)


KIND = SourceKind("zenoh", ZenohSourceConfig, ZenohChannelConfig, True, 'key = "..."', _build, _rebind)
