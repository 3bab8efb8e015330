"""What every source that others publish to has in the configuration, whatever carries the messages: what is in them."""

from typing import Annotated, Any, ClassVar, Self

from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer

from adapters.channel import LiveConfig, WatchedChannelConfig
from adapters.fields.values import Count, Duration, PositiveDuration, Text, TimeZone, choice, each_once
from adapters.fields.words import shown
from adapters.payload.json_pointer import parse, written
from adapters.payload.times import TIME_FORMATS

FORMATS = {"plain": (), "json": ("value", "time", "quality"), "senml": ("quality",)}

TIMES = ("payload", "zenoh", "arrival")


def pointer(value: object) -> tuple[str, ...]:
    """The reference tokens of a JSON pointer."""
    if not isinstance(value, str):
        raise ValueError(f'must be a JSON pointer in quotes, such as "/present/value", not {shown(value)}')
    return parse(value)


def quality_word(value: object) -> str:
    """A quality as it is compared: text in lower case, numbers as they are written, true and false."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value).strip().lower()


def word(value: object) -> str:
    if not isinstance(value, str | int | float):
        raise ValueError(f'must be a text, a number, true or false, such as "good" or 192, not {shown(value)}')
    return quality_word(value)


def times_of(*times: str) -> Any:
    return Annotated[
        tuple[Annotated[str, BeforeValidator(choice(*times))], ...],
        AfterValidator(each_once("{} names the same time twice")),
        Field(min_length=1, description=f"a list of {', '.join(times)} in the order of preference"),
    ]


Pointer = Annotated[tuple[str, ...], BeforeValidator(pointer), PlainSerializer(written, return_type=str)]
Words = tuple[Annotated[str, BeforeValidator(word)], ...]
Format = Annotated[str, BeforeValidator(choice(*FORMATS))]
TimeFormat = Annotated[str, BeforeValidator(choice(*TIME_FORMATS))]
_GOOD = 'a list of what stands for good, such as ["good", 192]'
_UNCERTAIN = 'a list of what stands for uncertain, such as ["uncertain", 64]'


class MessagesConfig(LiveConfig):
    """What the table of such a source says of all of its messages."""

    max_ahead: Duration = Field(default=10.0, description="how far a time may be ahead of this machine's clock")
    queue: Count = Field(
        default=1000, description="messages that wait per key or topic; beyond it the oldest is dropped"
    )
    longest_stretch: PositiveDuration = Field(
        default=900.0, description="counters: readings further apart give no power"
    )
    format: Format = "plain"
    value: Pointer = Field(default="/value", validate_default=True)
    time: Pointer | None = None
    quality: Pointer | None = None
    time_format: TimeFormat = "iso8601"
    time_zone: TimeZone | None = None
    good: Words = Field(default=("good",), description=_GOOD)
    uncertain: Words = Field(default=("uncertain",), description=_UNCERTAIN)


class MessageChannelConfig(WatchedChannelConfig):
    """A channel of such a source; None is taken over from it. `noun`: the key that says where its messages come."""

    noun: ClassVar[str]

    format: Format | None = Field(
        default=None, description="the number alone, a JSON document, or a SenML pack (RFC 8428)"
    )
    value: Pointer | None = Field(default=None, description='JSON: where the value is; `""`: the whole document')
    time: Pointer | None = Field(default=None, description="JSON: where the time is")
    quality: Pointer | None = Field(default=None, description="where the quality is, in SenML within the record")
    record: Text | None = Field(default=None, description="SenML: name of the record; none: the only one")
    time_format: TimeFormat | None = Field(default=None, description="text, s or ms since 1970")
    time_zone: TimeZone | None = Field(default=None, description="zone of times without offset")
    good: Words | None = Field(default=None, description=_GOOD)
    uncertain: Words | None = Field(default=None, description=_UNCERTAIN)

    @property
    def place(self) -> str:
        """The key expression or topic that it is published on."""
        return str(getattr(self, self.noun))

    @property
    def address(self) -> str:
        return " ".join(filter(None, (self.place, self.format, written(self.value or ()), self.record)))

    def within(self, table: Any) -> Self:
        form = self.format or table.format
        foreign = {"value", "time", "quality"} - set(FORMATS[form])
        for name in sorted(foreign, reverse=True):
            if getattr(self, name) is not None:
                raise ValueError(f'format "{form}" has no {name}; remove it, or use format "json"')
        if self.record is not None and form != "senml":
            raise ValueError(f'record is for format "senml", not "{form}"')
        return super().within(table).model_copy(update=dict.fromkeys(foreign))
