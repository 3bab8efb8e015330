"""What REST asks of zones beyond what they have at hand: computed on threads of its own, in fair shares, and for nobody
who has gone. A forecast over a week takes seconds."""

import asyncio
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor

from service.errors import ServiceError, TooManyQuestions
from service.records.asker import current_asker
from service.records.view import Answer

THREADS = 3
"""How many are answered at a time."""
THREADS_OF_ONE = 2
"""How many of one client: one thread is always left for the others."""
WAITING = 256
"""How many questions of all clients wait or are answered at most."""
WAITING_OF_ONE = 32
"""The same of one client."""


class Questions:
    """Puts questions to an executor of THREADS threads."""

    def __init__(self, executor: Executor, stopping: threading.Event) -> None:
        """Nothing is computed any more once `stopping` is set."""
        self._executor = executor
        self._stopping = stopping
        self._open: Counter[str] = Counter()
        self._turns: dict[str, asyncio.Semaphore] = {}

    async def ask(self, question: Callable[[Callable[[], bool]], Answer]) -> Answer:
        """What `question` returns; it is given a function that says whether nobody waits for the answer any more, and
        raises ServiceError then. TooManyQuestions if the client has too many open, or all clients together."""
        asker = current_asker()
        self._admit(asker.name)
        turn = self._turns.setdefault(asker.name, asyncio.Semaphore(THREADS_OF_ONE))

        def given_up() -> bool:
            return self._stopping.is_set() or asker.gone.is_set()

        def answered() -> Answer:
            if given_up():
                raise ServiceError("the question was given up because the daemon is stopping, or nobody waits for it")
            return question(given_up)

        self._open[asker.name] += 1
        try:
            async with turn:
                return await asyncio.get_running_loop().run_in_executor(self._executor, answered)
        finally:
            self._open[asker.name] -= 1
            if not self._open[asker.name]:
                del self._open[asker.name], self._turns[asker.name]

    def _admit(self, client: str) -> None:
        # The daemon's own questions are few.
        if client and self._open[client] >= WAITING_OF_ONE:
            raise TooManyQuestions(
                f"{WAITING_OF_ONE} of your requests are being computed, which is the limit for one client; wait for "
                "their answers"
            )
        if client and self._open.total() >= WAITING:
            raise TooManyQuestions(f"{WAITING} requests are being computed, which is the limit; try again later")
