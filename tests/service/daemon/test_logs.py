"""The log: one line each, in two forms, and not too many of a kind."""

import io
import json
import logging
import os
import threading
import warnings

from pydantic.warnings import UnsupportedFieldAttributeWarning

from service.config.log import LogConfig
from service.daemon.logs import JsonFormatter, LimitedHandler, PlainFormatter, Prefixed, configure_logging

_log = logging.getLogger("service.test")


class Written:
    """A limited log of its own, with a clock of its own."""

    def __init__(self, limit=3, formatter=None):
        self.now, self.stream = 0.0, io.StringIO()
        self.handler = LimitedHandler(self.stream, limit, lambda: self.now)
        self.handler.setFormatter(formatter or logging.Formatter("%(levelname)s %(message)s"))
        self.log = logging.Logger("test")
        self.log.addHandler(self.handler)

    def lines(self):
        return self.stream.getvalue().splitlines()


def record(message, *arguments, error=None):
    info = (type(error), error, error.__traceback__) if error else None
    made = logging.LogRecord("service.zone.zone", logging.ERROR, "zone.py", 1, message, arguments, info)
    made.created = 1_746_273_600.25
    return made


def failure():
    try:
        raise ValueError("two\nlines")
    except ValueError as error:
        return error


def test_plain_lines_are_one_line_whatever_is_in_them():
    written = PlainFormatter().format(record("zone '%s' failed: %s", "a", "x\ny\r\x1b[31m\u2028z °C", error=failure()))
    assert len(written.splitlines()) == 1
    assert written.startswith("2025-05-03T12:00:00Z ERROR zone 'a' failed: x\\ny\\r\\x1b[31m\\u2028z °C\\nTraceback")
    assert "ValueError: two\\nlines" in written


def test_json_lines_are_objects():
    written = JsonFormatter().format(record("zone '%s' failed: %s", "a", "x\n°", error=failure()))
    assert len(written.splitlines()) == 1
    line = json.loads(written)
    assert line.pop("traceback").endswith("ValueError: two\nlines")
    assert line == {
        "time": "2025-05-03T12:00:00.250Z",
        "level": "error",
        "logger": "service.zone.zone",
        "message": "zone 'a' failed: x\n°",
    }


def test_priorities_for_the_journal():
    plain = Prefixed(PlainFormatter(dated=False))
    assert plain.format(record("it failed")) == "<3>ERROR it failed"
    info = record("it works")
    info.levelno, info.levelname = logging.INFO, "INFO"
    assert plain.format(info) == "<6>INFO it works"
    info.levelno = logging.DEBUG
    assert plain.format(info).startswith("<7>")


def test_a_source_that_fails_all_the_time_does_not_fill_the_disk():
    written = Written(limit=3)
    for attempt in range(100):
        written.now = attempt * 0.1
        written.log.error("sources.%s: no answer; trying again in %.1f s", "bms", attempt)
        written.log.error("sources.%s: no answer; trying again in %.1f s", "other", attempt)
    assert len(written.lines()) == 6
    written.now = 61.0
    written.log.info("another")
    *_, first, second, last = written.lines()
    assert first == "ERROR 97 more like this were left out: sources.bms: no answer; trying again in 99.0 s"
    assert second == "ERROR 97 more like this were left out: sources.other: no answer; trying again in 99.0 s"
    assert last == "INFO another"
    # A new minute, and it may be said again.
    written.log.error("sources.%s: no answer; trying again in %.1f s", "bms", 1.0)
    assert written.lines()[-1] == "ERROR sources.bms: no answer; trying again in 1.0 s"


def test_a_thousand_zones_that_fail_at_once_do_not_either():
    written = Written(limit=3)
    for zone in range(1000):
        written.log.error("zone '%s' failed", zone)
    written.handler.sweep()
    assert len(written.lines()) == 60, "the minute is not over"
    written.now = 70.0
    written.handler.sweep()
    assert written.lines()[-1] == "ERROR 940 more like this were left out: zone '999' failed"
    for _ in range(5):
        written.log.error("it failed")
    written.handler.close()
    assert written.lines()[-1] == "ERROR 2 more like this were left out: it failed"


def test_kinds_are_forgotten_so_that_memory_is_bounded():
    written = Written(limit=1)
    for number in range(10_000):
        written.log.error(f"message {number}")
    assert len(written.handler._written) <= 4096


def test_configured_as_json_everybody_writes_json(restored, capfd):
    configure_logging(LogConfig(format="json", level="warning", limit=5))
    logging.getLogger("uvicorn.error").warning("from the server")
    logging.getLogger("service.zone.zone").info("too little")
    for _ in range(7):
        _log.error("again")
    died = threading.Thread(target=lambda: 1 / 0, name="helper")
    died.start()
    died.join()
    lines = [json.loads(line) for line in capfd.readouterr().err.splitlines()]
    assert [line["message"] for line in lines] == [
        "from the server",
        *["again"] * 5,
        "thread helper died: ZeroDivisionError('division by zero')",
    ]
    assert "ZeroDivisionError" in lines[-1]["traceback"]


def test_the_journal_is_known_by_its_stream(restored, monkeypatch, tmp_path):
    with (tmp_path / "log").open("w+") as stream:
        status = os.fstat(stream.fileno())
        monkeypatch.setattr("sys.stderr", stream)
        monkeypatch.setenv("JOURNAL_STREAM", f"{status.st_dev}:{status.st_ino}")
        configure_logging()
        _log.warning("seen")
        monkeypatch.setenv("JOURNAL_STREAM", "1:1")
        configure_logging()
        _log.warning("seen")
        stream.seek(0)
        first, second = stream.read().splitlines()
    assert first == "<4>WARNING seen"
    assert second.endswith("Z WARNING seen")


def test_a_warning_of_a_library_to_its_own_authors_is_not_the_operators(restored, capfd):
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        configure_logging(LogConfig())
        warnings.warn("for FastAPI", UnsupportedFieldAttributeWarning, stacklevel=1)
        warnings.warn("for everybody", UserWarning, stacklevel=1)
        logging.captureWarnings(False)
    told = capfd.readouterr().err
    assert "for everybody" in told
    assert "for FastAPI" not in told
