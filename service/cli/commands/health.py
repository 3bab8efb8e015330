"""`thermogate health`: asks a running daemon how it is, for monitoring plugins, containers and people."""

import argparse
import json
import ssl
import urllib.error
import urllib.request
from http import HTTPStatus
from http.client import HTTPException
from pathlib import Path
from typing import Any

from adapters.fields.addresses import is_web_address
from service.cli.arguments import AddCommand, positive
from service.errors import ServiceError, one_line

OK, WARNING, CRITICAL, UNKNOWN = range(4)
"""Exit codes as monitoring plugins have them."""
_WORDS = ("OK", "WARNING", "CRITICAL", "UNKNOWN")

_Answer = tuple[int, dict[str, Any]]
"""Status and document."""


def add_to(add: AddCommand) -> None:
    parser = add(
        "health",
        _health,
        "Check a running daemon: one line, and exit code 0 for good, 1 for zones without telemetry, 2 for a daemon "
        "that does not answer or zones that fail, 3 for unknown.",
    )
    parser.add_argument(
        "--url",
        default="http://127.0.0.1:8080",
        metavar="URL",
        help="address of the daemon (default http://127.0.0.1:8080)",
    )
    parser.add_argument("--alive", action="store_true", help="check only whether the process is alive; needs no key")
    parser.add_argument("--key-file", type=Path, metavar="FILE", help="a file with an API key and nothing else")
    ca = "PEM file of the authority that signed the daemon's certificate (default: the system's)"
    parser.add_argument("--ca-file", type=Path, metavar="FILE", help=ca)
    parser.add_argument(
        "--timeout", type=positive, default=10.0, metavar="SECONDS", help="how long to wait for an answer (default 10)"
    )


def _health(arguments: argparse.Namespace) -> int:
    code, sentence = _judged(arguments)
    print(f"{_WORDS[code]} - {one_line(sentence)}")
    return code


def _judged(arguments: argparse.Namespace) -> tuple[int, str]:
    url: str = arguments.url
    if not is_web_address(url):
        return UNKNOWN, f"{url} is no URL of a daemon; write one such as http://127.0.0.1:8080"
    try:
        key = None if arguments.key_file is None else _key(arguments.key_file)
        trusted = _trusted(arguments.ca_file)
    except ServiceError as error:
        return UNKNOWN, str(error)

    def get(path: str) -> _Answer:
        return _got(url.rstrip("/") + path, key, trusted, arguments.timeout)

    try:
        status, alive = get("/healthz")
        if status != HTTPStatus.OK:
            return CRITICAL, str(alive["detail"])
        if arguments.alive:
            return OK, f"version {alive['version']}, up for {alive['uptime_s']:.0f} s"
        ready = get("/readyz")
        if ready[0] == HTTPStatus.UNAUTHORIZED and key is None:
            return UNKNOWN, "the daemon wants an API key; name a file that holds one with --key-file"
        return _zones(*ready)
    except OSError as error:
        return CRITICAL, f"{url} does not answer: {getattr(error, 'reason', None) or error}"
    except (HTTPException, ValueError, LookupError, TypeError, AttributeError):
        return CRITICAL, f"{url} answers, but not as a daemon of Thermogate does; correct --url"


def _key(file: Path) -> str:
    """The API key in `file`; ServiceError, which does not repeat what is in the file, if it holds something else."""
    try:
        key = file.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", "it is no text")
        raise ServiceError(f"--key-file: {file} cannot be read: {reason}") from None
    if len(key.split()) != 1 or not key.isascii() or not key.isprintable():
        raise ServiceError(f"--key-file: {file} does not hold an API key and nothing else")
    return key


def _trusted(file: Path | None) -> ssl.SSLContext:
    try:
        return ssl.create_default_context(cafile=file)
    except OSError as error:
        raise ServiceError(f"--ca-file: {file} cannot be used: {error.strerror or error}") from None


def _got(url: str, key: str | None, trusted: ssl.SSLContext, timeout: float) -> _Answer:
    """The answer to GET `url`; OSError or ValueError if there is none that a daemon would give."""
    request = urllib.request.Request(url, headers={} if key is None else {"Authorization": f"Bearer {key}"})
    # No proxy of the environment: it is this daemon that is asked.
    direct, secured = urllib.request.ProxyHandler({}), urllib.request.HTTPSHandler(context=trusted)
    try:
        with urllib.request.build_opener(direct, secured).open(request, timeout=timeout) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, json.load(error)


def _zones(status: int, document: dict[str, Any]) -> tuple[int, str]:
    if status == HTTPStatus.OK:
        # A daemon of an earlier version lists all zones, and does not count them.
        return OK, f"zones running: {document.get('zone_count', len(document['zones']))}"
    behind = document.get("zones")
    if status != HTTPStatus.SERVICE_UNAVAILABLE or not behind:
        return UNKNOWN, str(document["detail"])
    failed = any(zone["state"] == "failed" for zone in behind)
    return CRITICAL if failed else WARNING, str(document["detail"])
