"""What every source that others publish to has in the configuration, whatever carries the messages: what is in them."""

from __future__ import annotations

from typing import Annotated, Any, Self
from zoneinfo import ZoneInfo

from pydantic import BaseModel, BeforeValidator, Field

from adapters.messages.points import MessageChannel
from adapters.payload.json_pointer import parse
from adapters.payload.payload import FORMATS, PayloadFormat, quality_word
from adapters.payload.times import TIME_FORMATS
from service.fields.tables import TABLE
from service.fields.values import Duration, PositiveDuration, Text, TimeZone, choice, whole
from service.fields.words import shown
from service.sources.channel import Binding, ChannelConfig, edge_of

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


class MessagesConfig(BaseModel):
    """What the table of such a source says of all of its messages."""

    model_config = TABLE

    max_ahead: Duration = 10.0
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


class MessageChannelConfig(ChannelConfig):
    """A channel of such a source; what is None is taken over from the source."""

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
    def place(self) -> str:
        """The key expression or topic that it is published on."""
        raise NotImplementedError

    @property
    def address(self) -> str:
        """Place and format."""
        return " ".join(filter(None, (self.place, self.format, self.value, self.record)))

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

    def within(self, table: Any) -> Self:
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


def message_channel(binding: Binding) -> MessageChannel:
    """What the adapters need of a channel of such a source."""
    channel: MessageChannelConfig = binding.channel
    edge = edge_of(channel, binding.unit, usual=binding.usual)
    return MessageChannel(binding.id, channel.place, channel.payload_format, edge, channel.stuck_after)
