"""The daemon's log on standard error: one line each, whatever is in it, and not too many of one kind.

Lines of one kind are those of one message template about one thing (its first argument: a zone, a source, a reason). Of
these, and of a template in all, only so many are written per minute; then a line says how many were left out.
"""

import json
import logging
import math
import os
import sys
import threading
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from copy import copy
from pathlib import Path
from types import TracebackType
from typing import TextIO

from pydantic.warnings import UnsupportedFieldAttributeWarning

from adapters.fields.times import written_time, written_to_the_millisecond
from service.config.log import LEVELS, LogConfig
from service.errors import one_line
from service.store.audit import AUDIT, Trail

WINDOW_SECONDS = 60.0
AUDITED_LINES = 2
"""Lines a minute of one event about one client in the audit trail."""
THINGS_PER_TEMPLATE = 20
"""A template may be written for so many things as often as for one: a thousand zones that fail at once fill no disk."""
_KINDS = 4096
"""Kinds of lines that are counted at most; then all are counted anew."""

_Kind = tuple[object, ...]
"""A message template, or one about one thing."""

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
    # Events of the audit trail pass the level of the root logger.
    handler.setLevel(LEVELS[config.level])
    logging.basicConfig(level=LEVELS[config.level], handlers=[handler], force=True)
    logging.captureWarnings(True)
    # FastAPI ignores these itself, which fails where another thread changes the filters at the same time.
    warnings.simplefilter("ignore", UnsupportedFieldAttributeWarning)
    threading.excepthook = _thread_died
    # The daemon says itself where it serves and when it stops.
    logging.getLogger("uvicorn").setLevel(logging.WARNING)


@contextmanager
def audited(folder: Path) -> Iterator[None]:
    """Keep the audit trail in the state `folder` meanwhile."""
    handler = LimitedHandler(Trail(folder), AUDITED_LINES)
    handler.setFormatter(JsonFormatter())
    AUDIT.addHandler(handler)
    try:
        yield
    finally:
        AUDIT.removeHandler(handler)
        handler.close()


def sweep_log() -> None:
    """Say what was left out of the log and the audit trail, where its minute is over; to be called now and then."""
    for handler in (*logging.getLogger().handlers, *AUDIT.handlers):
        if isinstance(handler, LimitedHandler):
            with handler.lock or nullcontext():
                handler.sweep()


class LimitedHandler(logging.StreamHandler[TextIO | Trail]):
    """Writes lines to a stream, of one kind at most `limit` per minute."""

    def __init__(self, stream: TextIO | Trail, limit: int, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(stream)
        self._limit, self._clock = limit, clock
        self._until = -math.inf
        """When the minute ends in which lines are counted."""
        self._written: Counter[_Kind] = Counter()
        self._left_out: dict[_Kind, tuple[int, logging.LogRecord]] = {}
        """How many lines of a kind were not written in this minute, and the last of them."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write the line, unless there were enough of its kind; the lock of the handler is held."""
        self.sweep()
        if self._until == -math.inf:
            self._until = self._clock() + WINDOW_SECONDS
        template = (record.name, record.levelno, str(record.msg))
        thing = (*template, str(record.args[0]) if isinstance(record.args, tuple) and record.args else None)
        # A template that is told of ever new things must not fill the memory with them.
        for kind, limit in ((template, self._limit * THINGS_PER_TEMPLATE), (thing, self._limit)):
            if self._written[kind] >= limit:
                self._left_out[kind] = self._left_out.get(kind, (0, record))[0] + 1, record
                return
        self._written.update((template, thing))
        super().emit(record)

    def sweep(self) -> None:
        """Say how many lines were left out, once their minute is over or there are too many kinds to count."""
        if self._clock() >= self._until or len(self._written) >= _KINDS:
            self._say()

    def close(self) -> None:
        """Say what was left out until now."""
        with self.lock or nullcontext():
            self._say()
        super().close()

    def _say(self) -> None:
        for count, last in self._left_out.values():
            said = copy(last)
            said.msg, said.args, said.exc_info = _LEFT_OUT, (count, last.getMessage()), None
            super().emit(said)
        self._written.clear()
        self._left_out.clear()
        self._until = -math.inf


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
        line |= {name: getattr(record, name) for name in ("event", "who") if hasattr(record, name)}
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
