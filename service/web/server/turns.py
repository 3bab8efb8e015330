"""The event loop shared between connections: whoever has more to read than fits a turn waits for the next one."""

from __future__ import annotations

import asyncio
import time
from typing import Protocol

PASS_SECONDS = 0.002
"""How long connections may hold one pass of the event loop between them."""

TURN_SECONDS = 0.001
"""How long one of them may before it is another one's turn."""

HALF_LIFE_SECONDS = 5.0
"""After how long half of what a connection has used is forgotten."""


class Taker(Protocol):
    """A connection, as far as it matters here."""

    account: Account

    def take_turn(self, deadline: float) -> bool:
        """Go on until `deadline` (monotonic s) or the end; whether there is more to do."""


class Account:
    """How much of the loop a connection has used lately, in s; what is long ago counts less."""

    def __init__(self) -> None:
        self._used = 0.0
        self._at = time.monotonic()

    def used(self, now: float) -> float:
        """What counts at `now`, monotonic s."""
        return float(self._used * 0.5 ** ((now - self._at) / HALF_LIFE_SECONDS))

    def charge(self, seconds: float, now: float) -> None:
        """Note that the connection has used `seconds` more."""
        self._used, self._at = self.used(now) + seconds, now


class Turns:
    """Lets connections take turns, those first that have used least: a client that sends much waits for the others."""

    def __init__(self) -> None:
        self._waiting: set[Taker] = set()
        self._scheduled = False

    def ask(self, taker: Taker) -> None:
        """Give `taker` a turn soon."""
        self._waiting.add(taker)
        if not self._scheduled:
            self._scheduled = True
            asyncio.get_running_loop().call_soon(self._pass)

    def leave(self, taker: Taker) -> None:
        """`taker` needs no turn any more."""
        self._waiting.discard(taker)

    def _pass(self) -> None:
        """As many turns as fit one pass of the loop, at least one; the others come in the next pass."""
        self._scheduled = False
        now = time.monotonic()
        last = now + PASS_SECONDS
        again: list[Taker] = []
        try:
            for taker in sorted(self._waiting, key=lambda one: one.account.used(now)):
                if now >= last:
                    break
                self._waiting.discard(taker)
                begun = now
                if taker.take_turn(begun + TURN_SECONDS):
                    again.append(taker)
                now = time.monotonic()
                taker.account.charge(now - begun, now)
        finally:
            for taker in (*again, *self._waiting):
                self.ask(taker)
