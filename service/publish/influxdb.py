"""What zones announce as InfluxDB line protocol, posted to a database or added to a file. A topic is the measurement
`thermogate_<topic>` with the fields of its JSON; a list there is one of its own, `thermogate_forecast_outputs`.
Documents wait in a thread of their own, MOST_WAITING bytes of them; beyond that the oldest are dropped."""

import json
import logging
import re
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

from pydantic import BeforeValidator, Field, model_validator

from adapters.errors import SourceError, SourceUnavailable
from adapters.fields.addresses import web_address
from adapters.fields.logins import LoginConfig
from adapters.fields.values import FilePath, Text
from adapters.series.database import Server
from service.pauses import GrowingPause
from service.publish.sinks import Announcement, Sink, SinkKind
from service.records.measures import Measure, single

MOST_WAITING = 16 * 2**20
"""Bytes of documents that wait for the database at most."""
_AT_ONCE = 2**20
"""Bytes of documents in one request, and one document more."""
_FIRST_PAUSE, _LONGEST_PAUSE = 1.0, 60.0
_CLOSE_SECONDS = 2.0

_TAGS = ("zone", "site", "output", "channel", "block", "level", "lead_s", "days", "member", "finding", "subject")
_LEFT_OUT = ("schema", "unit", "sample_time", "issue_time", "valid_time", "last_sample_time")
_SPECIAL = re.compile(r"([,= \\])")

_log = logging.getLogger(__name__)


class LinesConfig(LoginConfig):
    """[influxdb]: where forecasts go as line protocol."""

    url: Annotated[str, BeforeValidator(web_address("http://127.0.0.1:8086"))] | None = Field(
        default=None, description='the address of the database, such as `"http://127.0.0.1:8086"`'
    )
    database: Text = Field(default="thermogate", description="the name of the database; of the bucket in version 2")
    file: FilePath | None = Field(default=None, description="a file to add the lines to, in place of a database")

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if self.url is not None and self.file is not None:
            raise ValueError("give url or file, not both; lines go to one place")
        if self.url is None and (self.user is not None or self.database != type(self).model_fields["database"].default):
            raise ValueError('user and database need url, such as url = "http://127.0.0.1:8086"')
        return self

    def problems(self) -> Iterator[str]:
        """As of LoginConfig, and whether the file can be there."""
        yield from super().problems()
        if self.file is not None and not self.file.parent.is_dir():
            yield f"file: {self.file.parent} is no folder; make it, or give another file"


Write = Callable[[str], None]
"""Writes lines, all or none. SourceUnavailable where they may be taken later, else SourceConfigError."""


def to_database(table: LinesConfig, url: str) -> Write:
    """Over HTTP, by the interface of version 1, which the later versions have as well."""
    server = Server(url, table)
    return lambda lines: server.post("/write", {"db": table.database}, lines.encode())


def to_file(path: Path) -> Write:
    """At the end of a file."""

    def write(lines: str) -> None:
        try:
            # Opened every time: what rotates logs may have moved it.
            with path.open("ab", buffering=0) as file:
                size, content = file.tell(), lines.encode()
                if file.write(content) != len(content):
                    file.truncate(size)
                    raise OSError("the disk is full")
        except OSError as error:
            raise SourceUnavailable(f"{path} cannot be written ({error.strerror or error})") from error

    return write


class _Waiting(NamedTuple):
    """A document of `topic`, and when it was announced, UTC s."""

    topic: str
    document: bytes
    announced: float


class Writer(Sink):
    """Writes what zones announce, in a thread of its own. Methods may be called from any thread."""

    def __init__(self, write: Write) -> None:
        self._write = write
        self._waiting: deque[_Waiting] = deque()
        self._held = self._dropped = 0
        self._told: type[SourceError] | bool | None = None
        """What the log said last: that lines arrive, or what kind of error keeps them."""
        self._news = threading.Condition()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._attend, name="influxdb-writer", daemon=True)

    def open(self) -> Self:
        """Begin to write; a database that is away is waited for."""
        self._thread.start()
        return self

    def publish(self, announcement: Announcement) -> None:
        """Leave what is announced for the thread."""
        with self._news:
            for topic, document in announcement.lasting().items():
                self._waiting.append(_Waiting(topic, document, time.time()))
                self._held += len(document)
            self._drop_the_oldest()
            self._news.notify()

    def measures(self) -> list[Measure]:
        """Whether the lines arrive, and what did not."""
        return [
            Measure.called("thermogate_influxdb_connected", lambda: single(float(self._told is True))),
            Measure.called("thermogate_influxdb_documents_dropped", lambda: single(float(self._dropped))),
        ]

    def close(self) -> None:
        """Try once more to write what waits, within seconds; safe to call twice."""
        self._closing.set()
        with self._news:
            self._news.notify()
        if self._thread.is_alive():
            self._thread.join(_CLOSE_SECONDS)

    def _attend(self) -> None:
        """Write what is announced, until there is nothing more after `close`."""
        pause = GrowingPause(_FIRST_PAUSE, _LONGEST_PAUSE)
        while batch := self._next():
            try:
                self._write("".join(line for one in batch for line in lines_of(one.topic, one.document, one.announced)))
            except SourceUnavailable as error:
                waits = f"what is announced waits for it, {MOST_WAITING / 2**20:.0f} MiB at most"
                self._report(SourceUnavailable, f"{error}; {waits}")
                with self._news:
                    self._waiting.extendleft(reversed(batch))
                    self._held += sum(len(one.document) for one in batch)
                    self._drop_the_oldest()
                if self._closing.wait(pause.seconds):
                    return
                pause.grow()
            except SourceError as error:
                # It would be refused again, and what comes after it has to wait no longer.
                self._report(type(error), f"{error}; what is refused is dropped")
                with self._news:
                    self._dropped += len(batch)
            else:
                self._report(True, "lines arrive")
                pause.reset()

    def _next(self) -> list[_Waiting]:
        """What is to be written next, once there is something; empty at the end."""
        batch: list[_Waiting] = []
        size = 0
        with self._news:
            self._news.wait_for(lambda: self._waiting or self._closing.is_set())
            while self._waiting and size < _AT_ONCE:
                batch.append(self._waiting.popleft())
                size += len(batch[-1].document)
            self._held -= size
        return batch

    def _drop_the_oldest(self) -> None:
        """Keep what waits within its bound; `_news` is held."""
        while self._held > MOST_WAITING:
            self._held -= len(self._waiting.popleft().document)
            self._dropped += 1

    def _report(self, told: type[SourceError] | bool, sentence: str) -> None:
        if told is not self._told:
            _log.log(logging.INFO if told is True else logging.ERROR, "[influxdb]: %s", sentence)
        self._told = told


def lines_of(topic: str, document: bytes, announced: float) -> Iterator[str]:
    """The lines of the JSON `document` of `topic`, each with its line feed. A point has the time that it is about:
    `valid_time`, or else `sample_time`; the status has the time of the zone's clock, or else `announced`, UTC s."""
    content = json.loads(document)
    last = content.get("last_sample_time")
    now = announced if last is None else _seconds(last) + content["age_s"]
    yield from _points(f"thermogate_{topic}", content, {}, now)


def _points(measurement: str, node: Mapping[str, Any], tags: Mapping[str, str], moment: float) -> Iterator[str]:
    told = node.get("valid_time") or node.get("sample_time")
    moment = moment if told is None else _seconds(told)
    tags = {**tags, **{name: str(node[name]) for name in _TAGS if name in node}}
    below: list[tuple[str, Mapping[str, Any]]] = []
    fields = dict(_fields(node, "", below))
    if fields:
        head = ",".join([measurement, *(f"{name}={_plain(value)}" for name, value in tags.items() if value)])
        values = ",".join(f"{name}={value}" for name, value in fields.items())
        yield f"{head} {values} {round(moment)}000000000\n"
    for name, one in below:
        yield from _points(f"{measurement}_{name}", one, tags, moment)


def _fields(
    node: Mapping[str, Any], prefix: str, below: list[tuple[str, Mapping[str, Any]]]
) -> Iterator[tuple[str, str]]:
    """The fields of `node`, written; what is in its lists goes to `below`."""
    for name, value in node.items():
        if isinstance(value, dict):
            yield from _fields(value, f"{prefix}{name}_", below)
        elif isinstance(value, list):
            below += [(prefix + name, one) for one in value if isinstance(one, dict)]
        elif value is not None and name not in _LEFT_OUT and (prefix or name not in _TAGS):
            yield f"{prefix}{_plain(name)}", _written(value)


def _written(value: bool | float | str) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return '"' + re.sub(r'(["\\])', r"\\\1", value) + '"'
    # Without an `i` after it, a number is a float: a field must not change its type.
    return repr(value)


def _plain(name: str) -> str:
    return _SPECIAL.sub(r"\\\1", name)


def _seconds(written: str) -> float:
    return datetime.fromisoformat(written).timestamp()


def _open(table: LinesConfig, site: str) -> Writer | None:
    if table.url is not None:
        return Writer(to_database(table, table.url)).open()
    return None if table.file is None else Writer(to_file(table.file)).open()


KIND = SinkKind("influxdb", LinesConfig, _open)
