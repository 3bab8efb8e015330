"""The REST interface of a Thermogate daemon, as this integration uses it."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Mapping
from http import HTTPStatus
from typing import Any

import aiohttp

PATIENCE = aiohttp.ClientTimeout(total=120, sock_connect=30)
"""A small machine takes its time to begin with a zone."""
SILENCE = aiohttp.ClientTimeout(total=None, sock_connect=30, sock_read=60)
"""For streams: the daemon sends a comment every 15 s."""
LONGEST_LINE = 2**20


class DaemonError(Exception):
    """The daemon did not do what was asked; one sentence, for people."""

    form_error = "refused"
    """Its key in the texts of the forms."""


class Unreachable(DaemonError):
    """No daemon answers."""

    form_error = "cannot_connect"


class KeyRefused(DaemonError):
    """The key is unknown, revoked or expired, or its scope is not admin."""

    form_error = "invalid_auth"


class Refused(DaemonError):
    """The daemon understood the request and refused it."""

    def __init__(self, status: int, detail: str) -> None:
        super().__init__(detail)
        self.status = status


class Client:
    """A daemon at `url`, asked with the API key `key`, whose sentences are in `language`."""

    def __init__(self, session: aiohttp.ClientSession, url: str, key: str, language: str = "en") -> None:
        self.url = url.rstrip("/")
        self._session = session
        self._headers = {"Authorization": f"Bearer {key}"}
        self.spoken = {"language": "de"} if language.startswith("de") else {}
        """What to ask for with sentences; the daemon has them in English and German."""

    async def ask(
        self, method: str, path: str, body: object = None, params: Mapping[str, Any] | None = None
    ) -> dict[str, Any]:
        """The document that the daemon answers. Raises DaemonError."""
        try:
            async with self._session.request(
                method, self.url + path, json=body, params=params, headers=self._headers, timeout=PATIENCE
            ) as answer:
                await _check(answer)
                return await answer.json()
        except (aiohttp.ClientError, TimeoutError, ValueError) as error:
            raise self._unreachable(error) from error

    async def events(self, zone: str) -> AsyncIterator[tuple[str, dict[str, Any]]]:
        """Topic and document of everything that `zone` announces, from its current state on, until the daemon ends the
        stream. Raises DaemonError."""
        try:
            async with self._session.get(
                f"{self.url}/zones/{zone}/stream",
                params=self.spoken,
                headers=self._headers,
                timeout=SILENCE,
                read_bufsize=LONGEST_LINE,
            ) as answer:
                await _check(answer)
                topic = ""
                async for line in answer.content:
                    name, _, value = line.decode().rstrip("\r\n").partition(": ")
                    if name == "event":
                        topic = value
                    elif name == "data":
                        yield topic, json.loads(value)
        except (aiohttp.ClientError, TimeoutError, ValueError) as error:
            raise self._unreachable(error) from error

    def _unreachable(self, error: Exception) -> Unreachable:
        return Unreachable(f"no Thermogate daemon answers at {self.url} ({error or type(error).__name__})")


async def _check(answer: aiohttp.ClientResponse) -> None:
    """Raise DaemonError unless the request was granted."""
    if answer.status < HTTPStatus.BAD_REQUEST:
        return
    try:
        detail = str((await answer.json(content_type=None))["detail"])
    except (ValueError, KeyError, TypeError):
        detail = f"the answer is {answer.status} {answer.reason}"
    if answer.status in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN):
        raise KeyRefused(detail)
    raise Refused(answer.status, detail)
