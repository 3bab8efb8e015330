"""A coroutine in a thread with an event loop of its own, so that no flood there delays the loop of the daemon."""

import asyncio
import logging
import threading
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any

_log = logging.getLogger(__name__)


class Background:
    """Runs one coroutine until it ends or is stopped. Methods may be called from any thread."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._task: asyncio.Task[Any] | None = None
        self._begun = threading.Event()

    def start(self, work: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """Run what `work` makes; once."""
        # It must not keep the process alive.
        self._thread = threading.Thread(target=self._run, args=(work,), name=self._name, daemon=True)
        self._thread.start()
        self._begun.wait()

    def call(self, action: Callable[[], object]) -> None:
        """Call `action` in the loop of the coroutine; nothing where that has ended."""
        with suppress(RuntimeError):
            if self._loop is not None:
                self._loop.call_soon_threadsafe(action)

    def wait(self, seconds: float) -> bool:
        """Wait for the end of the coroutine; whether it came within `seconds`."""
        if self._thread is None:
            return True
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def stop(self, seconds: float) -> bool:
        """Cancel the coroutine and wait for its end; whether it came within `seconds`. Safe to call twice."""
        if self._task is not None:
            self.call(self._task.cancel)
        return self.wait(seconds)

    def _run(self, work: Callable[[], Coroutine[Any, Any, None]]) -> None:
        try:
            asyncio.run(self._attend(work))
        except asyncio.CancelledError:
            pass
        except Exception as error:
            _log.debug("%s has ended: %r", self._name, error)
        finally:
            self._begun.set()

    async def _attend(self, work: Callable[[], Coroutine[Any, Any, None]]) -> None:
        self._loop, self._task = asyncio.get_running_loop(), asyncio.current_task()
        self._begun.set()
        await work()
