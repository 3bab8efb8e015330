"""What a zone announces, rendered once for everyone, and the sinks that it goes to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from functools import cached_property
from typing import Any, NamedTuple, Protocol

from pydantic import BaseModel

from service.publish.payloads import (
    ForecastPayload,
    GainPayload,
    GatePayload,
    StatusPayload,
    VolatilityPayload,
    vouched,
)
from service.records.measures import Measure
from service.records.record import document
from service.records.skill import Skill
from service.records.status import ZoneStatus
from service.records.trust import Trust
from service.records.update import Update

TOPICS = ("forecast", "volatility", "gate", "gain", "skill", "trust", "status")
"""What a zone can tell, each as a JSON document of its own."""


class Occasion(Enum):
    """Why a zone announces something."""

    UPDATE = "a sample has brought an update"
    RESTORED = "the zone goes on with an update that was there before"
    STATUS = "the status alone has changed"


class Announcement:
    """What `zone` has to tell. Every topic is rendered when the first sink asks for it, and once."""

    def __init__(
        self,
        site: str,
        zone: str,
        status: ZoneStatus,
        update: Update | None,
        occasion: Occasion = Occasion.UPDATE,
        skill: Skill | None = None,
        heat_loss: Sequence[float] | None = None,
        trust: Trust | None = None,
    ) -> None:
        """`update` is the newest one of the zone; without any there is a status alone to tell. `skill`, `trust` and
        `heat_loss`, its quantiles at `ALPHA_LEVELS` in W/K, are given when there is news of them."""
        self.zone = zone
        self.status = status
        self.update = update
        self.occasion = Occasion.STATUS if update is None else occasion
        self.skill = skill
        self.heat_loss = heat_loss
        self.trust = trust if trust is not None and trust.horizons else None
        self._site = site
        self._rendered: dict[str, bytes] = {}

    @property
    def topics(self) -> tuple[str, ...]:
        """What there is to tell, in the order in which it is told."""
        if self.occasion is Occasion.STATUS or self.update is None:
            return ("status",) if self.trust is None else ("trust", "status")
        left_out = {
            "gain": self.update.disturbance is None,
            "skill": self.skill is None,
            "trust": self.trust is None,
        }
        return tuple(topic for topic in TOPICS if not left_out.get(topic, False))

    @cached_property
    def disowned(self) -> bool:
        """Whether the zone can no longer vouch for its forecast, which was good when it was issued."""
        if self.update is None:
            return False
        issued = ForecastPayload.of(self.update)
        return vouched(issued, self.status).quality is not issued.quality

    def payload(self, topic: str) -> bytes:
        """The document of `topic`, one of `topics`; the forecast also where the status alone has changed."""
        if topic not in self._rendered:
            self._rendered[topic] = document(self._told(topic), self._site, self.zone)
        return self._rendered[topic]

    def _told(self, topic: str) -> Any:
        """The record of `topic`."""
        if topic in ("skill", "trust"):
            return self.skill if topic == "skill" else self.trust
        if topic == "status":
            return StatusPayload.of(self.status, self.update)
        assert self.update is not None, f"there is no {topic} without an update"
        if topic == "forecast":
            return vouched(ForecastPayload.of(self.update), self.status)
        kinds = {"volatility": VolatilityPayload, "gate": GatePayload, "gain": GainPayload}
        return kinds[topic].of(self.update)  # type: ignore[attr-defined]


class Sink(Protocol):
    """Where announcements go. Every method may be called from any thread, and may raise ServiceError."""

    def add(self, zone: str) -> None:
        """Announcements of `zone` will come from now on."""

    def remove(self, zone: str) -> None:
        """None of `zone` will come any more; without effect if there were none."""

    def publish(self, announcement: Announcement) -> None:
        """Pass on what a zone has to tell. It must not wait for a network."""

    def settle(self) -> None:
        """Return once those whom the configuration wants to wait for are listening, or `close` was called."""

    def measures(self) -> list[Measure]:
        """What metrics tell of the sink."""

    def close(self) -> None:
        """Let go of everything; safe to call twice."""


class SinkKind(NamedTuple):
    """A kind of sink that the configuration opens: the name of its table, the table, what is wrong with one beyond what
    the table itself refuses, and how it is opened for a site; None where the table says that it is not wanted."""

    name: str
    table: type[BaseModel]
    problems: Callable[[Any], Sequence[str]]
    open: Callable[[Any, str], Sink | None]
