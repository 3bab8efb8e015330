"""On whose behalf something is computed, and whether they still wait for it."""

import threading
from contextvars import ContextVar


class Asker:
    """The client of a request. `gone` is set when its connection has ended."""

    def __init__(self, name: str = "") -> None:
        self.name = name
        self.gone = threading.Event()


_ASKER: ContextVar[Asker | None] = ContextVar("asker", default=None)


def asked_by(asker: Asker) -> None:
    """From here on, what this task does is done for `asker`."""
    _ASKER.set(asker)


def current_asker() -> Asker:
    """On whose behalf this task works; somebody without a name, who never goes, for the daemon's own."""
    return _ASKER.get() or Asker()
