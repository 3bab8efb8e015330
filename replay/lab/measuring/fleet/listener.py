"""A Zenoh subscriber to every forecast of a daemon, which notes when each one arrives."""

from __future__ import annotations

import json
import time
from collections import defaultdict
from datetime import datetime
from types import TracebackType
from typing import Self

import zenoh

from replay.errors import MeasurementError
from replay.lab.measuring.fleet.scenario import SITE
from replay.lab.measuring.zenoh_session import loopback_session


class Listener:
    """Open from the daemon's start on; a context manager. Times are monotonic s of this process."""

    def __init__(self, port: int) -> None:
        """`port`: where to listen on loopback for the daemon, which connects to it."""
        self._heard: list[tuple[float, bytes]] = []
        try:
            self._session = loopback_session("peer", port)
        except zenoh.ZError as error:
            raise MeasurementError(f"Zenoh cannot listen on port {port} ({error}); stop what uses it") from error
        self._session.declare_subscriber(f"thermogate/{SITE}/*/forecast", self._hear)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._session.close()

    def _hear(self, sample: zenoh.Sample) -> None:
        # Read later: what takes time here would be taken from the daemon that is measured.
        self._heard.append((time.monotonic(), sample.payload.to_bytes()))

    @property
    def count(self) -> int:
        """How many forecasts have arrived."""
        return len(self._heard)

    def arrivals(self) -> dict[float, dict[str, float]]:
        """Per sample time (UTC s): when the forecast of each zone arrived first."""
        rounds: dict[float, dict[str, float]] = defaultdict(dict)
        for arrived, payload in tuple(self._heard):
            forecast = json.loads(payload)
            sample_time = datetime.fromisoformat(forecast["sample_time"]).timestamp()
            rounds[sample_time].setdefault(forecast["zone"], arrived)
        return dict(rounds)
