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

from service.cli.arguments import AddCommand, positive
from service.errors import one_line
from service.fields.addresses import is_web_address

OK, WARNING, CRITICAL, UNKNOWN = range(4)
"""Exit codes as monitoring plugins have them."""

_WORDS = ("OK", "WARNING", "CRITICAL", "UNKNOWN")


class _Answer(NamedTuple):
    status: int
    document: dict[str, Any]


class _Unusable(Exception):
    """An option with which nobody can be asked; its text is one sentence."""


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
        alive = _ask(arguments, "/healthz")
        if alive.status != HTTPStatus.OK or arguments.alive:
            return _life(alive)
        return _zones(_ask(arguments, "/readyz"))
    except _Unusable as error:
        return UNKNOWN, str(error)
    except OSError as error:
        reason = getattr(error, "reason", None) or error
        return CRITICAL, f"{arguments.url} does not answer: {reason}"
    except (HTTPException, ValueError, LookupError, TypeError, AttributeError):
        return CRITICAL, f"{arguments.url} answers, but not as a daemon of Thermogate does; correct --url"


def _ask(arguments: argparse.Namespace, path: str) -> _Answer:
    request = urllib.request.Request(arguments.url.rstrip("/") + path)
    if arguments.key_file is not None:
        request.add_header("Authorization", f"Bearer {_key(arguments.key_file)}")
    try:
        context = ssl.create_default_context(cafile=arguments.ca_file)
    except OSError as error:
        raise _Unusable(f"--ca-file {arguments.ca_file} cannot be used: {error.strerror or error}") from None
    # No proxy of the environment: it is this daemon that is asked.
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}), urllib.request.HTTPSHandler(context=context))
    try:
        with opener.open(request, timeout=arguments.timeout) as answer:
            return _Answer(answer.status, json.load(answer))
    except urllib.error.HTTPError as error:
        with error:
            return _Answer(error.code, json.load(error))


def _key(path: Path) -> str:
    """The API key in the file at `path`."""
    try:
        key = path.read_text(encoding="ascii").strip()
    except OSError as error:
        raise _Unusable(f"--key-file {path} cannot be read: {error.strerror}") from None
    except ValueError:
        key = ""
    if not key.isprintable() or not key:
        raise _Unusable(f"--key-file {path} does not hold an API key and nothing else")
    return key


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
