"""The daemon's log on standard error: one line each, whatever is in it, and not too many of one kind.

Lines of one kind are those of one message template about one thing (its first argument: a zone, a source, a reason). Of
these, and of a template in all, only so many are written per minute; then a line says how many were left out.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import nullcontext
from types import TracebackType
from typing import TextIO

from adapters.fields.times import written_time, written_to_the_millisecond
from service.config.log import LEVELS, LogConfig

WINDOW_SECONDS = 60.0
SWEEP_SECONDS = 5.0

THINGS_PER_TEMPLATE = 20
"""A template may be written for so many things as often as for one: a thousand zones that fail at once fill no disk."""

_KINDS = 4096
"""Kinds of lines that are counted at a time; the one not seen for longest is forgotten."""

_LEFT_OUT = "%d more like this were left out: %s"

_PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))
"""Levels as syslog counts them; what is less is 7."""


def configure_logging(config: LogConfig | None = None) -> None:
    """Write the log as `config` says, everybody's: ours, the server's, Python's warnings, and threads that die."""
    config = config or LogConfig()
    handler = LimitedHandler(sys.stderr, config.limit)
    journal = _is_journal(sys.stderr)
    formatter: logging.Formatter = JsonFormatter() if config.format == "json" else PlainFormatter(dated=not journal)
    handler.setFormatter(Prefixed(formatter) if journal else formatter)
    logging.basicConfig(level=LEVELS[config.level], handlers=[handler], force=True)
    logging.captureWarnings(True)
    threading.excepthook = _thread_died
    # The daemon says itself where it serves and when it stops.
    logging.getLogger("uvicorn").setLevel(logging.WARNING)


def sweep_log() -> None:
    """Say what was left out of the log, where its minute is over; to be called now and then."""
    for handler in logging.getLogger().handlers:
        if isinstance(handler, LimitedHandler):
            with handler.lock or nullcontext():
                handler.sweep()


class LimitedHandler(logging.StreamHandler[TextIO]):
    """Writes lines to a stream, of one kind at most `limit` per minute."""

    def __init__(self, stream: TextIO, limit: int, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(stream)
        self._limit, self._clock = limit, clock
        self._kinds: OrderedDict[tuple[object, ...], _Kind] = OrderedDict()
        self._next_sweep = clock() + SWEEP_SECONDS

    def emit(self, record: logging.LogRecord) -> None:
        """Write the line, unless there were enough of its kind; the lock of the handler is held."""
        self.sweep()
        now = self._clock()
        template = (record.name, record.levelno, str(record.msg))
        thing = (*template, str(record.args[0]) if isinstance(record.args, tuple) and record.args else None)
        wanted = self._counted(thing, self._limit, record, now)
        if wanted and self._counted(template, self._limit * THINGS_PER_TEMPLATE, record, now):
            super().emit(record)

    def sweep(self) -> None:
        """Say of every kind whose minute is over how many lines were left out."""
        now = self._clock()
        if now < self._next_sweep:
            return
        self._next_sweep = now + SWEEP_SECONDS
        for key, kind in [(key, kind) for key, kind in self._kinds.items() if kind.until <= now]:
            del self._kinds[key]
            self._say(kind)

    def close(self) -> None:
        """Say what was left out until now."""
        with self.lock or nullcontext():
            for kind in self._kinds.values():
                self._say(kind)
            self._kinds.clear()
        super().close()

    def _counted(self, key: tuple[object, ...], limit: int, record: logging.LogRecord, now: float) -> bool:
        """Whether one more line of this kind may be written."""
        kind = self._kinds.get(key)
        if kind is not None and kind.until <= now:
            del self._kinds[key]
            self._say(kind)
            kind = None
        if kind is None:
            kind = self._kinds[key] = _Kind(now + WINDOW_SECONDS)
            if len(self._kinds) > _KINDS:
                self._say(self._kinds.popitem(last=False)[1])
        kind.count += 1
        if kind.count <= limit:
            return True
        kind.left_out, kind.last = kind.left_out + 1, record
        return False

    def _say(self, kind: _Kind) -> None:
        if kind.last is not None:
            last = kind.last
            words = (kind.left_out, last.getMessage())
            said = logging.LogRecord(last.name, last.levelno, last.pathname, last.lineno, _LEFT_OUT, words, None)
            super().emit(said)


class _Kind:
    """Lines of one kind within a minute that ends at `until`."""

    def __init__(self, until: float) -> None:
        self.until = until
        self.count = 0
        self.left_out = 0
        self.last: logging.LogRecord | None = None


class PlainFormatter(logging.Formatter):
    """UTC time, level, message; what would break the line, or steer a terminal, is escaped."""

    def __init__(self, dated: bool = True) -> None:
        super().__init__("%(asctime)s %(levelname)s %(message)s" if dated else "%(levelname)s %(message)s")

    def formatTime(self, record: logging.LogRecord, datefmt: str | None = None) -> str:
        return written_time(record.created)

    def format(self, record: logging.LogRecord) -> str:
        return one_line(super().format(record))


class JsonFormatter(logging.Formatter):
    """An object a line: time, level, logger, message, and the traceback where there is one."""

    def format(self, record: logging.LogRecord) -> str:
        line = {
            "time": written_to_the_millisecond(record.created),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line)


class Prefixed(logging.Formatter):
    """Lines of another formatter with the priority in front, as systemd's journal reads it (sd-daemon(3))."""

    def __init__(self, formatter: logging.Formatter) -> None:
        super().__init__()
        self._formatter = formatter

    def format(self, record: logging.LogRecord) -> str:
        priority = next((number for level, number in _PRIORITIES if record.levelno >= level), 7)
        return f"<{priority}>{self._formatter.format(record)}"


def one_line(text: str) -> str:
    """`text` with everything escaped that is no printable character."""
    return text if text.isprintable() else "".join(c if c.isprintable() else _escaped(c) for c in text)


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode()


def _is_journal(stream: TextIO) -> bool:
    """Whether `stream` leads to systemd's journal; JOURNAL_STREAM then names it."""
    try:
        status = os.fstat(stream.fileno())
    except (OSError, ValueError):
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"


def _thread_died(died: threading.ExceptHookArgs) -> None:
    name = "a thread" if died.thread is None else f"thread {died.thread.name}"
    error: tuple[type[BaseException], BaseException, TracebackType | None] | None = None
    if died.exc_value is not None:
        error = (died.exc_type, died.exc_value, died.exc_traceback)
    logging.getLogger(__name__).error("%s died: %r", name, died.exc_value, exc_info=error)
