"""Forecasts that are published on Zenoh, as documents."""

from collections.abc import AsyncIterator
from functools import partial

from adapters.errors import SourceError, SourceUnavailable
from adapters.messages.inbox import LONGEST_PAYLOAD, Inbox
from adapters.weather.document import parse
from adapters.weather.forecast import WeatherForecast
from adapters.zenoh.access import ANYBODY, collecting
from adapters.zenoh.connection import SessionConfig
from adapters.zenoh.link import ZenohLink, key_problem

_WAIT = 60.0


class HeardForecasts:
    """Documents on one key; one is issued when it was sent, unless it says otherwise."""

    def __init__(self, name: str, session: SessionConfig, key: str) -> None:
        self.name = name
        self._session, self._key = session, key
        self._link: ZenohLink | None = None

    def check(self) -> list[str]:
        problem = key_problem(self._key)
        found = [] if problem is None else [f"weather.{self.name}.key: {problem}"]
        return found + [f"weather.{self.name}: {problem}" for problem in self._session.problems()]

    async def forecasts(self) -> AsyncIterator[WeatherForecast]:
        """Every document as it comes, beginning with the last one if its publisher keeps it."""
        # Only the newest forecast matters.
        inbox = Inbox([self._key], 1)
        heard = partial(inbox.put, self._key)
        try:
            await self.close()
            self._link = link = ZenohLink(self._session, collecting((ANYBODY,), relaying=False))
            await link.open()
            link.subscribe(self._key, heard, last=True)
            link.ask(self._key, heard, 5.0)
            while True:
                await inbox.wait(_WAIT)
                for _, sample, _ in inbox.waiting():
                    if sample.payload is None:
                        long = f"has {sample.size} bytes; at most {LONGEST_PAYLOAD} are read"
                        what = long if sample.size else "was deleted"
                        raise SourceUnavailable(f"the document on {sample.key} {what}")
                    yield parse(sample.payload, sample.arrived if sample.stamp is None else sample.stamp)
        except SourceError as error:
            raise SourceUnavailable(f"weather.{self.name}: {error}") from error

    async def close(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            await link.close()
