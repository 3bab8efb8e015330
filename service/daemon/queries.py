"""Questions on Zenoh, answered by the routes of REST: the same parameters, answers and errors."""

import asyncio
import logging
from collections.abc import Callable
from urllib.parse import urlencode

from starlette.types import ASGIApp

from service.publish.zenoh import Question, Reply
from service.web.keys import Caller
from service.web.server.in_process import ask

ROUTES = {
    "fan": ("GET", "/zones/{zone}/forecast"),
    "plan": ("POST", "/zones/{zone}/forecast"),
    "model": ("GET", "/zones/{zone}/model"),
    "parameters": ("GET", "/zones/{zone}/parameters"),
    "preheat": ("GET", "/zones/{zone}/preheat"),
    "demand": ("POST", "/zones/{zone}/demand"),
    "what-if": ("POST", "/zones/{zone}/what-if"),
    "forecasts": ("POST", "/forecasts"),
}
"""The route that answers each question."""
LONGEST = 1_000_000
"""Bytes of a payload at most, as a body of REST by default."""
_CALLER = Caller(name="zenoh")
"""Who may connect to Zenoh is decided there, and may read every zone."""

_log = logging.getLogger(__name__)


class Queries:
    """Asks the routes of an application what comes on Zenoh."""

    def __init__(
        self, routes: ASGIApp, loop: asyncio.AbstractEventLoop, allowed: Callable[[], bool] = lambda: True
    ) -> None:
        """`routes` are those of REST without what guards them from other machines; they run in `loop`, while that is
        `allowed`."""
        self._routes, self._loop, self._allowed = routes, loop, allowed

    def answer(self, question: Question, reply: Callable[[Reply], None]) -> None:
        """Begin to answer `question`; `reply` gets the answer. From any thread."""
        if not self._allowed():
            reply(Reply(False, b'{"detail": "the zones of this shard may be another one\'s by now; ask again"}'))
            return
        try:
            asyncio.run_coroutine_threadsafe(self._answered(question, reply), self._loop)
        except RuntimeError:
            # The loop has ended, and with it the daemon.
            reply(Reply(False, b'{"detail": "the daemon is stopping"}'))

    async def _answered(self, question: Question, reply: Callable[[Reply], None]) -> None:
        answer = Reply(False, b'{"detail": "the daemon failed to answer this question; its log says why"}')
        try:
            answer = await self._asked(question)
        except Exception as error:
            _log.error("the question %s on Zenoh failed: %r", question.topic, error)
        finally:
            reply(answer)

    async def _asked(self, question: Question) -> Reply:
        method, pattern = ROUTES[question.topic]
        if len(question.payload) > LONGEST:
            return Reply(False, b'{"detail": "the payload has more than %d bytes; send less"}' % LONGEST)
        answered = await ask(
            self._routes,
            method,
            pattern.format(zone=question.zone),
            query=urlencode(question.parameters),
            body=question.payload,
            state={"caller": _CALLER, "client": "zenoh"},
        )
        return Reply(answered.good, answered.body)
