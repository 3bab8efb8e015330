"""What a zone announces, rendered once for everyone, and the sinks that it goes to."""

import logging
from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from typing import Any, NamedTuple, Self

from adapters.fields.logins import LoginConfig
from service.errors import ServiceError
from service.publish.language import LANGUAGES, told_in
from service.publish.payloads import (
    AheadPayload,
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
from service.records.status import ZoneState
from service.records.trust import Trust

TOPICS = ("forecast", "ahead", "volatility", "gate", "gain", "skill", "trust", "status")
"""What a zone can tell, each as a JSON document of its own."""
_SPEAKING = ("trust", "status")
"""Topics with sentences."""

_log = logging.getLogger(__name__)


class Occasion(Enum):
    """Why a zone announces something."""

    UPDATE = "a sample has brought an update"
    RESTORED = "the zone goes on with an update that was there before"
    STATUS = "the status alone has changed"


class Reports(NamedTuple):
    """What a zone tells less often than after every sample; None where there is no news of it."""

    skill: Skill | None = None
    heat_loss: Sequence[float] | None = None
    """Its quantiles at `ALPHA_LEVELS`, W/K."""
    trust: Trust | None = None
    ahead: AheadPayload | None = None

    def beside(self, before: Self) -> Self:
        """These, and those of `before` of which there is no news."""
        return before._replace(**{name: report for name, report in self._asdict().items() if report is not None})


NO_REPORTS = Reports()


class Announcement:
    """What `zone` has to tell. Every topic is rendered when the first sink asks for it, and once."""

    def __init__(
        self,
        site: str,
        zone: str,
        state: ZoneState,
        occasion: Occasion = Occasion.UPDATE,
        reports: Reports = NO_REPORTS,
    ) -> None:
        """Before the first update of the zone there is a status alone to tell."""
        self.site, self.zone, self.state = site, zone, state
        self.status, self.update = state.status, state.update
        self.occasion = Occasion.STATUS if state.update is None else occasion
        judged = reports.trust is not None and bool(reports.trust.horizons)
        self.reports = reports if judged else reports._replace(trust=None)
        self._rendered: dict[str, bytes] = {}

    def __reduce__(self) -> tuple[object, ...]:
        """Without what was rendered."""
        return Announcement, (self.site, self.zone, self.state, self.occasion, self.reports)

    @property
    def topics(self) -> tuple[str, ...]:
        """What there is to tell, in the order in which it is told."""
        told = {"status": True} | {name: report is not None for name, report in self.reports._asdict().items()}
        if self.occasion is not Occasion.STATUS and self.update is not None:
            told |= dict.fromkeys(("forecast", "volatility", "gate"), True)
            told["gain"] = self.update.disturbance is not None
        return tuple(topic for topic in TOPICS if told.get(topic, False))

    def lasting(self, language: str = LANGUAGES[0]) -> dict[str, bytes]:
        """The documents of `topics` in `language` for sinks whose last word stays: also the forecast, marked bad, where
        the status alone has changed and the zone can no longer vouch for it. Who comes later must not take it for
        good."""
        told = {topic: self.payload(topic, language) for topic in self.topics}
        if self.occasion is Occasion.STATUS and self.update is not None:
            issued = ForecastPayload.of(self.update)
            if vouched(issued, self.status).quality is not issued.quality:
                told["forecast"] = self.payload("forecast", language)
        return told

    def payload(self, topic: str, language: str = LANGUAGES[0]) -> bytes:
        """The document of `topic` in `language`; the forecast also where the status alone has changed."""
        if topic not in self._rendered:
            self._rendered[topic] = document(self._told(topic), self.site, self.zone)
        return told_in(language, self._rendered[topic]) if topic in _SPEAKING else self._rendered[topic]

    def _told(self, topic: str) -> Any:
        if topic in ("skill", "trust", "ahead"):
            return getattr(self.reports, topic)
        if topic == "status":
            return StatusPayload.of(self.status, self.update)
        assert self.update is not None, f"there is no {topic} without an update"
        if topic == "forecast":
            return vouched(ForecastPayload.of(self.update), self.status)
        kinds = {"volatility": VolatilityPayload, "gate": GatePayload, "gain": GainPayload}
        return kinds[topic].of(self.update)  # type: ignore[attr-defined]


class Sink:
    """Where announcements go. Every method may be called from any thread, and may raise ServiceError."""

    def add(self, zone: str) -> None:
        """Announcements of `zone` will come from now on."""

    def remove(self, zone: str) -> None:
        """None of `zone` will come any more; without effect if there were none."""

    def publish(self, announcement: Announcement) -> None:
        """Pass on what a zone has to tell. It must not wait for a network."""
        raise NotImplementedError

    def settle(self) -> None:
        """Return once those whom the configuration wants to wait for are listening, or `close` was called."""

    def measures(self) -> list[Measure]:
        """What metrics tell of the sink."""
        return []

    def close(self) -> None:
        """Let go of everything; safe to call twice."""


def tell(sinks: Iterable[Sink], announcement: Announcement) -> None:
    """Let every sink publish; one that cannot be reached keeps neither the zone nor the others."""
    for sink in sinks:
        try:
            sink.publish(announcement)
        except ServiceError as error:
            _log.warning("zone '%s': %s", announcement.zone, error)


class SinkKind(NamedTuple):
    """A kind of sink that the configuration opens: the name of its table, the table, and how it is opened for a site;
    None where the table says that it is not wanted."""

    name: str
    table: type[LoginConfig]
    open: Callable[[Any, str], Sink | None]
