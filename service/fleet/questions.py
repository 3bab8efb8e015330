"""Questions on Zenoh in a fleet: a shard answers those to its zones, a gateway those to the whole site."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from service.publish.zenoh import Answering, Question, Reply
from service.records.view import ZoneView

_ELSEWHERE = b'{"detail": "the zones of this shard may be another one\'s by now; ask again"}'


def answers(site: str, zones: Mapping[str, ZoneView], allowed: Callable[[], bool] = lambda: True) -> Answering:
    """What answers questions to `zones`, in the running loop, as far as it is `allowed` at the time."""
    # The routes take long to import, and a shard without Zenoh does without them.
    from service.daemon.queries import Queries
    from service.web.app import create_questions

    queries = Queries(create_questions(site, zones), asyncio.get_running_loop())

    def answer(question: Question, reply: Callable[[Reply], None]) -> None:
        if allowed():
            queries.answer(question, reply)
        else:
            reply(Reply(False, _ELSEWHERE))

    return answer
