"""What databases of time series are asked over HTTP, and what their answers say."""

import asyncio
import base64
import json
import re
import time
import urllib.error
import urllib.request
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from http.client import HTTPException
from math import isfinite
from typing import Any, NamedTuple
from urllib.parse import urlencode

import numpy as np
import numpy.typing as npt

from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.fields.logins import LoginConfig

_TIMEOUT = 60.0
"""s that an answer may take."""

_LARGEST = 64 * 2**20
"""Bytes of an answer at most; a page of 5,000 numbers has a hundredth of it."""

_LOOK_BACK = 100
"""Steps in which the newest value of a channel is searched."""

_LATER = (HTTPStatus.TOO_MANY_REQUESTS,)
_POSTED_LATER = (*_LATER, HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN, HTTPStatus.NOT_FOUND)
"""Statuses below 500 of what may succeed later."""

_SAID = 200
"""Characters of an error that the database tells at most."""


class Points(NamedTuple):
    """A series of m points in the order of time."""

    times: npt.NDArray[np.float64]
    """(m,): UTC s."""
    values: npt.NDArray[np.float64]
    """(m,): finite."""


@dataclass(frozen=True)
class Server:
    """Where a database answers, and as whom it is asked: `url` without a path, and the user of `login` or nobody."""

    url: str
    login: LoginConfig

    async def ask(self, path: str, parameters: Mapping[str, str]) -> Any:
        """The JSON that `path` answers. Raises SourceUnavailable, and SourceConfigError where it is refused."""
        try:
            return json.loads(await asyncio.to_thread(self._answered, path, parameters))
        except ValueError as error:
            raise SourceUnavailable(f"{self.url} does not answer in JSON; is another server there?") from error

    def post(self, path: str, parameters: Mapping[str, str], body: bytes) -> None:
        """Post the text `body` to `path`. Raises as `ask` does, but SourceUnavailable for a login or a database that
        there is not yet: what is posted need not be lost for that."""
        self._answered(path, parameters, body)

    def _answered(self, path: str, parameters: Mapping[str, str], posted: bytes | None = None) -> bytes:
        headers = {} if posted is None else {"Content-Type": "text/plain; charset=utf-8"}
        request = urllib.request.Request(f"{self.url.rstrip('/')}{path}?{urlencode(parameters)}", posted, headers)
        user, secret = self.login.credentials()
        if user is not None:
            login = f"{user}:{secret}".encode()
            request.add_header("Authorization", f"Basic {base64.b64encode(login).decode()}")
        try:
            with urllib.request.urlopen(request, timeout=_TIMEOUT) as answer:
                body = answer.read(_LARGEST + 1)
        except urllib.error.HTTPError as error:
            said = error.reason
            # The connection may break off before all is told.
            with error, suppress(OSError, HTTPException):
                said = error.read(_SAID).decode("utf-8", "replace").strip()
            sentence = f"{self.url} answers {error.code} {said}"
            if error.code in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN):
                sentence = f"{self.url} refuses the login ({error.code}); check user and password"
            elif error.code < 500:
                sentence = f"{self.url} refuses the question ({error.code}: {said})"
            later = error.code >= 500 or error.code in (_LATER if posted is None else _POSTED_LATER)
            raise (SourceUnavailable if later else SourceConfigError)(sentence) from error
        except (OSError, ValueError, HTTPException) as error:
            reason = getattr(error, "reason", None) or error
            raise SourceUnavailable(f"{self.url} cannot be reached ({reason}); check url and network") from error
        if len(body) > _LARGEST:
            raise SourceUnavailable(f"{self.url} answers more than {_LARGEST} bytes; give a longer step")
        return body


class Database:
    """A history that is asked for a stretch of time: from the `begin` of its `table` to its end, or else to now."""

    def __init__(self, table: Any) -> None:
        self.table = table

    async def points(self, channel: Any, begin: float, end: float, counter: bool) -> Points:
        """What `channel` has in [begin, end), UTC s, one point every `step` s at most; of a counter what it showed.
        Raises SourceError."""
        raise NotImplementedError

    async def newest(self, channel: Any) -> Points:
        """Points of `channel`, the last of which is its newest; none if there is nothing new. Raises SourceError."""
        _, end = await self.span([channel])
        return await self.points(channel, end - _LOOK_BACK * self.table.step, end, False)

    async def span(self, channels: Sequence[Any]) -> tuple[float, float]:
        """The stretch of time in which `channels` have values, UTC s. Raises SourceError."""
        return self.table.begin, time.time() if self.table.end is None else self.table.end

    def problems(self, channels: Sequence[Any]) -> list[str]:
        """What is wrong with `channels`, one sentence each, as far as that can be told without asking a server."""
        return []

    async def close(self) -> None:
        """Release what it holds; safe to call twice."""


class Prometheus(Database):
    """Prometheus, VictoriaMetrics and others with its range queries."""

    async def points(self, channel: Any, begin: float, end: float, counter: bool) -> Points:
        """The values of a PromQL expression at begin, begin + step, ..., each at most 5 min old."""
        query, step, server = channel.query, self.table.step, self.table.server
        asked = {"query": query, "start": f"{begin:.3f}", "end": f"{end - 1e-3:.3f}", "step": f"{step:g}"}
        answer = await server.ask("/api/v1/query_range", asked)
        try:
            found = answer["data"]["result"]
            if len(found) > 1:
                labels = ", ".join(json.dumps(one["metric"]) for one in found[:3])
                remedy = "add labels, or an aggregation such as avg(...)"
                raise SourceConfigError(f"'{query}' gives {len(found)} series ({labels}, ...); {remedy}")
            return _points([(when, float(value)) for when, value in found[0]["values"]] if found else [])
        except (KeyError, TypeError, IndexError, ValueError) as error:
            raise _surprising(server) from error


class InfluxDB(Database):
    """InfluxDB, versions 1, 2 and 3, by the interface of version 1: InfluxQL over `/query`."""

    async def points(self, channel: Any, begin: float, end: float, counter: bool) -> Points:
        """The means over every step of what a query such as `"value" FROM "degC" WHERE "room" = '101'` selects; of a
        counter what it showed when the step began."""
        query, server = channel.query, self.table.server
        field, source, condition = parts(query)
        first, last, every = round(1000 * begin), round(1000 * end), round(1000 * self.table.step)
        where = f"time >= {first:d}ms AND time < {last:d}ms"
        if condition:
            where = f"({condition}) AND {where}"
        aggregate = "first" if counter else "mean"
        asked = f"SELECT {aggregate}({field}) FROM {source} WHERE {where} GROUP BY time({every:d}ms) fill(none)"  # noqa: S608
        answer = await server.ask("/query", {"db": self.table.database, "epoch": "ms", "q": asked})
        try:
            (result,) = answer["results"]
            if "error" in result:
                raise SourceConfigError(f"{server.url} refuses '{query}': {result['error'][:_SAID]}")
            rows = [row for series in result.get("series", ()) for row in series["values"]]
            return _points([(milliseconds / 1000, float(value)) for milliseconds, value in rows if value is not None])
        except (KeyError, TypeError, ValueError) as error:
            raise _surprising(server) from error


def parts(query: str) -> tuple[str, str, str]:
    """Field, measurement and condition ("" for none) of a query for InfluxDB; ValueError if it is not of that form."""
    selected, said, rest = query.partition(" FROM ")
    source, _, condition = rest.partition(" WHERE ")
    # A source only reads; what the operator writes here must stay one SELECT.
    writes = ";" in query or re.search(r"\bINTO\b", query, re.IGNORECASE)
    if not (said and selected.strip() and source.strip()) or writes:
        raise ValueError('must be of the form "field" FROM "measurement" WHERE "tag" = \'value\'')
    return selected.strip(), source.strip(), condition.strip()


def _points(pairs: list[tuple[float, float]]) -> Points:
    times, values = np.array([pair for pair in pairs if isfinite(pair[1])], dtype=np.float64).reshape(-1, 2).T
    return Points(times, values)


def _surprising(server: Server) -> SourceUnavailable:
    return SourceUnavailable(
        f"{server.url} answers something else than it documents; is it the right kind of database?"
    )
