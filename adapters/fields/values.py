"""Values of the configuration file, each with a check that says in one sentence what is wrong and what to write."""

import difflib
import ipaddress
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any
from zoneinfo import ZoneInfo, available_timezones

from pydantic import AfterValidator, BeforeValidator, PlainSerializer, PlainValidator, ValidationInfo

from adapters.errors import SourceConfigError
from adapters.fields.durations import DAY, format_duration, parse_duration
from adapters.fields.numbers import is_level, number_in, whole_in
from adapters.fields.sizes import format_size, parse_size
from adapters.fields.words import shown
from adapters.holidays import public_holidays
from adapters.timestamps import timestamp_parser

IDENTIFIER = r"[a-z0-9][a-z0-9_-]{0,63}"
"""What a site, source or zone id is made of, as a regular expression."""
_ENDPOINT = re.compile(r"(?:tcp|tls|quic|udp|ws)/(?P<host>\[[0-9a-fA-F:.]+\]|[^\s:/?#\[\]]+):(?P<port>[0-9]{1,5})")
_SENSIBLE_PERIODS = (1, 5, 10, 15, 20, 30, 60, 120, 180, 300, 360, 600, 900, 1200, 1800, 3600, 7200)

SMALLEST_JOURNAL = 16 * 10**6
"""Below this the write-ahead log alone takes a good part of it."""

LARGEST_JOURNAL = 4 * 10**18

LONGEST_TIMEOUT = 60.0


def check(read: Callable[[Any], Any], sentence: str, shape: str = "") -> Callable[[object], Any]:
    """What takes the values of which `read` makes something, and gives that; ValueError for one of which it makes None,
    with a `sentence` that has the value at {}. `shape`: what it asks for, as the documentation shows it."""

    def checked(value: object) -> Any:
        if (found := read(value)) is None:
            raise ValueError(sentence.format(shown(value)))
        return found

    checked.shape = shape  # type: ignore[attr-defined]
    return checked


def text(value: object) -> str:
    if not isinstance(value, str) or not value:
        raise ValueError(f"must be a text in quotes, not {shown(value) if value != '' else 'an empty one'}")
    return value


def column(value: object) -> str:
    """The name of a column, which may be empty: so do many programs call the column of the row names."""
    return "" if value == "" else text(value)


def matching(pattern: str) -> Callable[[object], str | None]:
    """What reads a text that has the form of `pattern`."""
    form = re.compile(pattern)
    return lambda value: value if isinstance(value, str) and form.fullmatch(value) else None


flag = check(lambda value: value if isinstance(value, bool) else None, "must be true or false, without quotes, not {}")
number = check(number_in, "must be a number, without quotes, not {}")
positive = check(lambda value: found if (found := number(value)) > 0 else None, "must be greater than 0, not {}")
non_zero = check(lambda value: number(value) or None, "must not be 0, which would make every reading the same")


def _meter_or_share(value: object) -> str | float | None:
    """A name or a share; None for neither."""
    if isinstance(value, str):
        return value or None
    found = number_in(value)
    return found if found is not None and 0.001 <= found <= 1 else None


share = check(
    _meter_or_share,
    'must be the name of a meter in quotes, such as "boiler", or a number from 0.001 to 1, not {}',
    "text, or 0.001 to 1",
)
level = check(
    lambda value: found if is_level(found := number(value)) else None,
    "must lie between 0 and 1, such as 0.95, not {}",
)
positive_duration = check(lambda value: parse_duration(value) or None, "must be longer than 0, not {}")
name = check(
    matching("[A-Za-z][A-Za-z0-9_]{0,63}"),
    "{} cannot be a name; use letters, digits and _, beginning with a letter, such as T_air",
)
ordered = check(lambda pair: pair if pair[0] < pair[1] else None, "{} is reversed; write the smaller number first")
delimiter = check(matching(r'[^"\r\n]'), 'must be one character, such as "," or ";" or "\\t", not {}')


def number_between(lower: float, upper: float, unit: str) -> Callable[[object], float]:
    within = f"{lower:g} to {upper:g} {unit}"
    return check(
        lambda value: found if lower <= (found := number(value)) <= upper else None,
        f"must be from {within}, not {{}}",
        within,
    )


def whole(lower: int, upper: int) -> Callable[[object], int]:
    return check(
        lambda value: whole_in(value, lower, upper),
        f"must be a whole number from {lower} to {upper}, not {{}}",
        f"{lower} or {upper}" if upper == lower + 1 else f"{lower} to {upper}",
    )


def choice(*allowed: str) -> Callable[[object], str]:
    *others, last = (shown(one) for one in allowed)
    return check(
        lambda value: value if value in allowed else None,
        f"must be {', '.join(others)} or {last}, not {{}}",
        ", ".join(f'`"{one}"`' for one in allowed),
    )


def identifier(value: object) -> str:
    """A site, source or zone id: it becomes part of file names and key expressions."""
    if not isinstance(value, str):
        raise ValueError(f'must be a text in quotes, such as "living-1", not {shown(value)}')
    if not re.fullmatch(IDENTIFIER, value):
        raise ValueError(
            f"{shown(value)} cannot be an id; use lower-case letters, digits, - and _, beginning with a letter or "
            'digit, at most 64 characters, such as "living-1"'
        )
    return value


def bearable(seconds: float) -> float:
    if seconds > LONGEST_TIMEOUT:
        raise ValueError(f"must be at most {format_duration(LONGEST_TIMEOUT)}, not {format_duration(seconds)}")
    return seconds


def journal_size(value: object) -> int:
    size = parse_size(value)
    if not SMALLEST_JOURNAL <= size <= LARGEST_JOURNAL:
        bound, limit = ("most", LARGEST_JOURNAL) if size > LARGEST_JOURNAL else ("least", SMALLEST_JOURNAL)
        raise ValueError(f"must be at {bound} {format_size(limit)}, not {shown(value)}")
    return size


def period(value: object) -> int:
    """A sampling period in whole seconds, such that the grid restarts at every UTC midnight."""
    seconds = positive_duration(value)
    if seconds != int(seconds) or DAY % seconds:
        below = [sensible for sensible in _SENSIBLE_PERIODS if sensible < seconds][-1:]
        above = [sensible for sensible in _SENSIBLE_PERIODS if sensible > seconds][:1]
        near = " or ".join(format_duration(sensible) for sensible in (*below, *above))
        raise ValueError(f"{shown(value)} does not divide a day into equal whole seconds; use for example {near}")
    return int(seconds)


def each_once(sentence: str) -> Callable[[object], Any]:
    """What takes a tuple without the same item twice."""
    return check(lambda items: items if len(set(items)) == len(items) else None, sentence)


def pace(value: object) -> float:
    """A multiple of real time; "max" becomes infinity."""
    if value == "max":
        return math.inf
    found = number_in(value)
    if found is None or not found > 0:
        raise ValueError(
            f'must be "max" (as fast as possible) or a multiple of real time above 0, such as 60, not {shown(value)}'
        )
    return found


def is_loopback(host: str) -> bool:
    return host == "localhost" or _is_ip(host, "is_loopback")


def _is_ip(host: str, what: str) -> bool:
    try:
        return bool(getattr(ipaddress.ip_address(host.strip("[]")), what))
    except ValueError:
        return False


def endpoint(value: object) -> str:
    match = _ENDPOINT.fullmatch(text(value))
    if not match or int(match["port"]) > 65535:
        raise ValueError(
            f"{shown(value)} is not an endpoint; write protocol/host:port with tcp, tls, quic, udp or ws, such as "
            '"tcp/127.0.0.1:7447"'
        )
    if _is_ip(match["host"], "is_multicast"):
        # Zenoh's access control does not look at what comes in there.
        raise ValueError(f"{shown(value)} is a multicast address, where anybody could put anything; give a host's own")
    return str(value)


def loopback_endpoint(value: object) -> str:
    if not is_loopback(endpoint(value).split("/", 1)[1].rsplit(":", 1)[0]):
        raise ValueError(
            f"{shown(value)} is not on a loopback address, and a simulated building has no credentials to serve other "
            'machines; use 127.0.0.1, [::1] or localhost, such as "tcp/127.0.0.1:7447"'
        )
    return str(value)


def time_zone(value: object) -> str:
    try:
        ZoneInfo(text(value))
    except (KeyError, OSError, ValueError):
        known = available_timezones()
        close = difflib.get_close_matches(str(value), known, n=1, cutoff=0.8)
        meant = f'did you mean "{close[0]}"?' if close else 'use a name such as "UTC" or "Europe/Berlin"'
        raise ValueError(f"{shown(value)} is not a time zone; {meant}") from None
    return str(value)


def country(value: object) -> str:
    """The code of a country or a part of it whose public holidays are known."""
    public_holidays(text(value))
    return str(value)


def timestamp_format(value: object) -> str:
    try:
        timestamp_parser(text(value))
    except SourceConfigError as error:
        raise ValueError(str(error)) from None
    return str(value)


def encoding(value: object) -> str:
    try:
        # The codecs of Python that turn bytes into bytes are none.
        "".encode(text(value))
    except (LookupError, ValueError):
        raise ValueError(f'{shown(value)} is not a text encoding; use for example "utf-8" or "cp1252"') from None
    return str(value)


def context(info: ValidationInfo) -> dict[str, Any]:
    """What `load` knows beyond the table at hand: `folder` of the file, the `site` id, and the id of the `source`."""
    return info.context or {}


def path(value: object, info: ValidationInfo) -> Path:
    """An absolute path; a relative one is taken from the configuration file's folder (`folder` of the context)."""
    given = Path(value if isinstance(value, Path) else text(value))
    if "\0" in str(given):
        raise ValueError(f"{shown(str(given))} has a character in it that no path has")
    if "-----BEGIN" in str(given) or "\n" in str(given):
        raise ValueError(
            "is the content of a file; put it into a file that only the daemon can read, and give its path"
        )
    try:
        return Path(context(info)["folder"], given.expanduser())
    except RuntimeError:
        raise ValueError(
            f"{shown(value)} begins with the home folder of an unknown user; write the whole path"
        ) from None


# A check before pydantic's own makes ours the only sentence an operator can see about a value.
Text = Annotated[str, BeforeValidator(text)]
Column = Annotated[str, BeforeValidator(column)]
Flag = Annotated[bool, BeforeValidator(flag)]
Number = Annotated[float, BeforeValidator(number)]
Positive = Annotated[float, BeforeValidator(positive)]
NonZero = Annotated[float, BeforeValidator(non_zero)]
Port = Annotated[int, BeforeValidator(whole(1, 65535))]
Retries = Annotated[int, BeforeValidator(whole(0, 10))]
Count = Annotated[int, BeforeValidator(whole(1, 100_000))]
Identifier = Annotated[str, BeforeValidator(identifier)]
Name = Annotated[str, BeforeValidator(name)]
Share = Annotated[str | float, BeforeValidator(share)]
Level = Annotated[float, BeforeValidator(level)]
Levels = Annotated[tuple[Level, ...], AfterValidator(each_once("{} lists the same level twice; list every level once"))]
Range = Annotated[tuple[Number, Number], AfterValidator(ordered)]
_AsText: Any = PlainSerializer(format_duration, return_type=str)
Duration = Annotated[float, BeforeValidator(parse_duration), _AsText]
PositiveDuration = Annotated[float, BeforeValidator(positive_duration), _AsText]
Timeout = Annotated[PositiveDuration, AfterValidator(bearable)]
JournalSize = Annotated[int, BeforeValidator(journal_size), PlainSerializer(format_size)]
Period = Annotated[int, BeforeValidator(period), _AsText]
Pace = Annotated[float, PlainValidator(pace), PlainSerializer(lambda pace: "max" if pace == math.inf else pace)]
Endpoint = Annotated[str, BeforeValidator(endpoint)]
TimeZone = Annotated[str, BeforeValidator(time_zone)]
Country = Annotated[str, BeforeValidator(country)]
TimestampFormat = Annotated[str, BeforeValidator(timestamp_format)]
Delimiter = Annotated[str, BeforeValidator(delimiter)]
Encoding = Annotated[str, BeforeValidator(encoding)]
FilePath = Annotated[Path, BeforeValidator(path)]
