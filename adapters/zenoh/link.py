"""The Zenoh session of a source: opened, watched and closed; Zenoh's errors as ours."""

import asyncio
import json
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

import zenoh
import zenoh.ext

from adapters.cancelling import in_thread
from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.messages.inbox import LONGEST_PAYLOAD, Incoming
from adapters.zenoh.connection import SessionConfig

_CLOSE_SECONDS = 1.0

OnSample = Callable[[Incoming], None]


class ZenohLink:
    """A session with its subscriptions, with `access` as its access control."""

    def __init__(self, table: SessionConfig, access: Mapping[str, object]) -> None:
        self._table, self._access = table, access
        self._session: Any = None
        self._subscriptions: dict[str, Any] = {}

    async def open(self) -> None:
        """Open the session. Raises SourceConfigError for what the settings have wrong, and SourceUnavailable if nobody
        answers within the timeout (mode "client") or an address is taken."""
        config = session_config(self._table, self._access)
        try:
            self._session = await in_thread(lambda: zenoh.open(config), lambda late: late.close())
        except zenoh.ZError as error:
            text = first_line(error)
            raise SourceUnavailable(await in_thread(lambda: _why(self._table, text))) from error

    def subscribe(self, key: str, on_sample: OnSample, recover: float = 0.0, last: bool = False) -> None:
        """Call `on_sample`, in Zenoh's threads, for every sample on `key`; one subscription for each key.

        `recover`: samples missed, up to this age in s, are asked of publishers that keep a cache; `last`: so is their
        last one, whatever its age. Raises SourceConfigError for a wrong key expression.
        """

        def arrived(sample: zenoh.Sample) -> None:
            on_sample(_incoming(sample))

        # A direct callback needs no thread of its own, which would keep the process alive.
        handler = zenoh.handlers.Callback(arrived, indirect=False)
        try:
            if recover or last:
                self._subscriptions[key] = zenoh.ext.declare_advanced_subscriber(
                    self._session,
                    key,
                    handler,
                    history=zenoh.ext.HistoryConfig(
                        detect_late_publishers=True,
                        max_age=None if last else recover,
                        max_samples=1 if last else None,
                    ),
                    recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                )
            else:
                self._subscriptions[key] = self._session.declare_subscriber(key, handler)
        except zenoh.ZError as error:
            raise SourceUnavailable(f'key "{key}" cannot be subscribed to ({first_line(error)})') from error

    async def unsubscribe(self, key: str) -> None:
        with suppress(zenoh.ZError):
            await in_thread(self._subscriptions.pop(key).undeclare)

    def ask(self, key: str, on_sample: OnSample, seconds: float) -> None:
        """Call `on_sample` for every answer to a query of `key` that comes within `seconds`."""

        def answered(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                on_sample(_incoming(reply.ok))

        with suppress(zenoh.ZError):
            self._session.get(key, zenoh.handlers.Callback(answered, indirect=False), timeout=seconds)

    @property
    def connected(self) -> bool:
        """Whether anybody at all is at the other end."""
        try:
            return bool(self._session.info.transports())
        except zenoh.ZError:
            return False

    async def close(self) -> None:
        """Close the session, if it was open; gives up after a second rather than hang."""
        if self._session is None:
            return
        with suppress(TimeoutError):
            async with asyncio.timeout(_CLOSE_SECONDS):
                await in_thread(self._undeclare)

    def _undeclare(self) -> None:
        for step in (*(subscription.undeclare for subscription in self._subscriptions.values()), self._session.close):
            with suppress(zenoh.ZError):
                step()


def key_problem(key: str) -> str | None:
    """What is wrong with a key expression, or None."""
    try:
        zenoh.KeyExpr(key)
    except zenoh.ZError as error:
        return first_line(error).split(": ", 1)[-1]
    return None


def _incoming(sample: zenoh.Sample) -> Incoming:
    size = len(sample.payload)
    deleted = sample.kind == zenoh.SampleKind.DELETE
    return Incoming(
        str(sample.key_expr),
        None if deleted or size > LONGEST_PAYLOAD else sample.payload.to_bytes(),
        size,
        None if sample.timestamp is None else sample.timestamp.get_time().timestamp(),
        time.time(),
    )


def session_config(table: SessionConfig, access: Mapping[str, object]) -> zenoh.Config:
    """The settings of the session in `table` for Zenoh; SourceConfigError for one that Zenoh does not take."""
    config = zenoh.Config()
    for key, value in table.settings(access).items():
        try:
            config.insert_json5(key, json.dumps(value))
        except zenoh.ZError as error:
            raise SourceConfigError(f"Zenoh does not take {key} ({first_line(error)})") from None
    return config


def _why(table: SessionConfig, text: str) -> str:
    """Why the session did not open, of which Zenoh says `text`, and the remedy."""
    if "in use" in text or "listener" in text:
        return f"listen: an address of {', '.join(table.listen)} cannot be used ({text}); choose another"
    return refusal(table) or (
        f"no Zenoh session answers at {', '.join(table.connect)}; start it, or correct the address"
    )


def refusal(table: SessionConfig) -> str | None:
    """The sentence about endpoints that accept a TCP connection but no session; None if there are none."""
    refusing = [endpoint for endpoint in table.connect if _answers(endpoint)]
    if not refusing:
        return None
    return (
        f"{', '.join(refusing)} can be reached but does not take this session; check user and password, "
        "certificates, and that it speaks Zenoh there"
    )


def _answers(endpoint: str) -> bool:
    """Whether something accepts TCP connections at `endpoint`."""
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if protocol not in ("tcp", "tls", "ws"):
        return False
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=1.0):
            return True
    except (OSError, UnicodeError):
        # A host of two dots in a row is no name that could be looked up.
        return False


def first_line(error: Exception) -> str:
    """The message without the place in Zenoh's own source code."""
    return str(error).splitlines()[0].split(" at /")[0].strip()
