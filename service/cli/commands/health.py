"""`thermogate health`: asks a running daemon how it is, for monitoring plugins, containers and people."""

from __future__ import annotations

import argparse
import json
import ssl
import urllib.error
import urllib.request
from http import HTTPStatus
from http.client import HTTPException
from pathlib import Path
from typing import Any, NamedTuple

from adapters.fields.addresses import is_web_address
from service.cli.arguments import AddCommand, positive
from service.errors import one_line

OK, WARNING, CRITICAL, UNKNOWN = range(4)
"""Exit codes as monitoring plugins have them."""

_WORDS = ("OK", "WARNING", "CRITICAL", "UNKNOWN")


class _Answer(NamedTuple):
    status: int
    document: dict[str, Any]


def add_to(add: AddCommand) -> None:
    """Add the command by `add(name, command, text)`."""
    parser = add(
        "health",
        _health,
        "Ask a running daemon how it is: one line, and exit code 0 for good, 1 for zones without telemetry, 2 for a "
        "daemon that does not answer or zones that fail, 3 where it cannot be told.",
    )
    parser.add_argument(
        "--url", default="http://127.0.0.1:8080", metavar="URL", help="where it serves (default http://127.0.0.1:8080)"
    )
    parser.add_argument("--alive", action="store_true", help="ask only whether the process is alive; needs no key")
    parser.add_argument("--key-file", type=Path, metavar="FILE", help="a file with an API key and nothing else")
    parser.add_argument(
        "--ca-file",
        type=Path,
        metavar="FILE",
        help="PEM of who signed the daemon's certificate (default: the system's)",
    )
    parser.add_argument(
        "--timeout", type=positive, default=10.0, metavar="SECONDS", help="how long to wait for an answer (default 10)"
    )


def _health(arguments: argparse.Namespace) -> int:
    code, sentence = _judged(arguments)
    print(f"{_WORDS[code]} - {one_line(sentence)}")
    return code


def _judged(arguments: argparse.Namespace) -> tuple[int, str]:
    if not is_web_address(arguments.url):
        return UNKNOWN, f"{arguments.url} is no URL of a daemon; write one such as http://127.0.0.1:8080"
    try:
        ask = _Asking(
            arguments.url.rstrip("/"), _key(arguments.key_file), _trusted(arguments.ca_file), arguments.timeout
        )
    except _UnusableFile as error:
        return UNKNOWN, str(error)
    try:
        alive = ask.get("/healthz")
        if alive.status != HTTPStatus.OK or arguments.alive:
            return _life(alive)
        ready = ask.get("/readyz")
        if ready.status == HTTPStatus.UNAUTHORIZED and ask.key is None:
            return UNKNOWN, "the daemon wants an API key; name a file that holds one with --key-file"
        return _zones(ready)
    except OSError as error:
        reason = getattr(error, "reason", None) or error
        return CRITICAL, f"{arguments.url} does not answer: {reason}"
    except (HTTPException, ValueError, LookupError, TypeError, AttributeError):
        return CRITICAL, f"{arguments.url} answers, but not as a daemon of Thermogate does; correct --url"


class _UnusableFile(Exception):
    """One sentence about a file that an option names; it does not repeat what is in the file."""


def _key(file: Path | None) -> str | None:
    if file is None:
        return None
    try:
        key = file.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise _UnusableFile(
            f"--key-file: {file} cannot be read: {getattr(error, 'strerror', 'it is no text')}"
        ) from None
    if len(key.split()) != 1 or not key.isascii() or not key.isprintable():
        raise _UnusableFile(f"--key-file: {file} does not hold an API key and nothing else")
    return key


def _trusted(file: Path | None) -> ssl.SSLContext:
    try:
        return ssl.create_default_context(cafile=file)
    except OSError as error:
        raise _UnusableFile(f"--ca-file: {file} cannot be used: {error.strerror or error}") from None


class _Asking(NamedTuple):
    """Whom to ask, and how."""

    url: str
    key: str | None
    trusted: ssl.SSLContext
    timeout: float

    def get(self, path: str) -> _Answer:
        """The answer to GET `path`; OSError or ValueError if there is none that a daemon would give."""
        request = urllib.request.Request(self.url + path)
        if self.key is not None:
            request.add_header("Authorization", f"Bearer {self.key}")
        # No proxy of the environment: it is this daemon that is asked.
        direct, secured = urllib.request.ProxyHandler({}), urllib.request.HTTPSHandler(context=self.trusted)
        try:
            with urllib.request.build_opener(direct, secured).open(request, timeout=self.timeout) as answer:
                return _Answer(answer.status, json.load(answer))
        except urllib.error.HTTPError as error:
            with error:
                return _Answer(error.code, json.load(error))


def _life(answer: _Answer) -> tuple[int, str]:
    if answer.status == HTTPStatus.OK:
        return OK, f"version {answer.document['version']}, up for {answer.document['uptime_s']:.0f} s"
    return CRITICAL, str(answer.document["detail"])


def _zones(answer: _Answer) -> tuple[int, str]:
    if answer.status == HTTPStatus.OK:
        # A daemon of an earlier version lists all zones, and does not count them.
        count = answer.document.get("zone_count", len(answer.document["zones"]))
        return OK, f"zones running: {count}"
    behind = answer.document.get("zones")
    if answer.status != HTTPStatus.SERVICE_UNAVAILABLE or not behind:
        return UNKNOWN, str(answer.document["detail"])
    failed = any(zone["state"] == "failed" for zone in behind)
    return CRITICAL if failed else WARNING, str(answer.document["detail"])
