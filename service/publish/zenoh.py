"""What every zone announces on Zenoh, in one session: the keys `thermogate/<site>/<zone>/{forecast,volatility,...}`,
whose last value also answers queries, a liveliness token `.../alive`, and keys that only answer QUESTIONS, as REST
does. Who connects may read these and do nothing else, neither towards the daemon nor through it to others. Where the
network is congested, messages are dropped."""

import json
import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from threading import BoundedSemaphore
from typing import Any, NamedTuple, Self

import zenoh
from pydantic import Field, model_validator

from adapters.errors import SourceConfigError
from adapters.fields.values import Duration, Endpoint, Flag
from adapters.zenoh.access import publishing
from adapters.zenoh.connection import Mode, SessionConfig
from adapters.zenoh.link import first_line, refusal, session_config
from service.errors import ServiceError
from service.publish.sinks import TOPICS, Announcement, Sink, SinkKind
from service.records.measures import Measure, Rows, single

_POLL_SECONDS = 0.02
_CLOSE_SECONDS = 1.0
QUESTIONS = ("fan", "plan", "model", "parameters", "preheat", "demand", "what-if")
"""What a zone answers on a key of its own: the fan, the fan under a plan that is the payload, the model, and the
parameters."""
SITE_QUESTION = "forecasts"
"""What the site answers: forecasts of several zones under plans that are the payload."""
MOST_QUESTIONS = 64
"""Questions that wait for their answers at most; others are refused."""

_log = logging.getLogger(__name__)


class Question(NamedTuple):
    """What a query asks: `topic` is one of QUESTIONS of a `zone`, or SITE_QUESTION without one; the values of every
    parameter; and the payload, empty if there is none."""

    zone: str | None
    topic: str
    parameters: Sequence[tuple[str, str]]
    payload: bytes


class Reply(NamedTuple):
    """The JSON that answers a question; `good` unless it is a problem."""

    good: bool
    content: bytes


Answering = Callable[[Question, Callable[[Reply], None]], None]
"""Begins to answer a question and returns; the answer goes to the function, from any thread, once."""


class ZenohConfig(SessionConfig):
    """[zenoh]: the daemon's own session."""

    enabled: Flag = Field(default=True, description="false: nothing is published on Zenoh")
    mode: Mode = Field(default="peer", description="role of the session")
    listen: tuple[Endpoint, ...] = Field(
        default=("tcp/127.0.0.1:7447",), description='a list of endpoints, such as ["tcp/127.0.0.1:7447"]'
    )
    await_subscriber: Duration = Field(default=0.0, description="at start, wait so long for subscribers of every zone")

    @model_validator(mode="after")
    def _client_has_a_router(self) -> Self:
        if self.enabled and self.mode == "client" and not self.connect:
            raise ValueError('mode "client" needs a router to connect to; list it in connect, or use mode "peer"')
        return self

    def problems(self) -> Iterator[str]:
        """As of SessionConfig, where the session is wanted."""
        return super().problems() if self.enabled else iter(())


class Publisher(Sink):
    """An open session with its publishers, queryables and tokens. Methods may be called from any thread."""

    def __init__(self, session: zenoh.Session, site: str, patience: float = 0.0) -> None:
        """`patience` is how long `settle` waits for subscribers, s."""
        self._session = session
        self._site = site
        self._patience = patience
        self._closed = False
        self._last: dict[str, bytes] = {}
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._declared: dict[str, list[Any]] = {}
        """Everything that was declared for a zone, to be undeclared in this order; for the site under its own name."""
        self._answering: Answering | None = None
        self._waiting = BoundedSemaphore(MOST_QUESTIONS)

    @classmethod
    def open(cls, table: ZenohConfig, site: str) -> Self:
        """Open the session, in which everyone who can connect may read what `site` publishes, and do nothing else;
        ServiceError if an address is taken, no router can be reached or none takes us."""
        try:
            config = session_config(table, publishing(f"thermogate/{site}/**"))
            return cls(zenoh.open(config), site, table.await_subscriber)
        except SourceConfigError as error:
            raise ServiceError(f"[zenoh]: {error}") from error
        except zenoh.ZError as error:
            raise _opening_failed(table, first_line(error)) from error

    def answer_with(self, answering: Answering, of_site: bool = True) -> None:
        """Answer questions from now on, and that of the site as well unless others know all its zones; ServiceError if
        its key cannot be declared."""
        declared, self._answering = self._answering is not None, answering
        if declared or not of_site:
            return
        key = f"thermogate/{self._site}/{SITE_QUESTION}"
        try:
            self._declared.setdefault("", []).append(self._questioned(key, None, SITE_QUESTION))
        except zenoh.ZError as error:
            raise ServiceError(f"[zenoh]: {key} cannot be declared ({first_line(error)})") from error

    def add(self, zone: str) -> None:
        """Publish `zone` from now on; ServiceError if its keys cannot be declared."""
        base = self._base(zone)
        declared = self._declared[zone] = []
        try:
            for topic in TOPICS:
                key = f"{base}/{topic}"
                self._publishers[key] = self._session.declare_publisher(
                    key,
                    encoding=zenoh.Encoding.APPLICATION_JSON,
                    congestion_control=zenoh.CongestionControl.DROP,
                )
                # A direct callback needs no thread of its own, so none can keep the process alive.
                answer = zenoh.handlers.Callback(self._answer, indirect=False)
                declared += [self._session.declare_queryable(key, answer), self._publishers[key]]
            declared += [self._questioned(f"{base}/{topic}", zone, topic) for topic in QUESTIONS]
            declared.insert(0, self._session.liveliness().declare_token(f"{base}/alive"))
        except zenoh.ZError as error:
            self.remove(zone)
            raise ServiceError(f"[zenoh]: {base}/... cannot be declared ({first_line(error)})") from error

    def remove(self, zone: str) -> None:
        """Publish `zone` no longer; without effect if it is not published."""
        for topic in TOPICS:
            key = f"{self._base(zone)}/{topic}"
            self._publishers.pop(key, None)
            self._last.pop(key, None)
        _give_up([one.undeclare for one in self._declared.pop(zone, [])])

    def publish(self, announcement: Announcement) -> None:
        """Put what is announced, a forecast that is told again only once; ServiceError if the session has failed.
        Nothing after `close`."""
        base = self._base(announcement.zone)
        for topic, document in announcement.lasting().items():
            if topic in announcement.topics or self._last.get(f"{base}/{topic}") != document:
                self._put(f"{base}/{topic}", document)

    def settle(self) -> None:
        """Wait until every zone's forecast has a subscriber, for as long as the configuration says."""
        self.await_subscriber(self._patience)

    def measures(self) -> list[Measure]:
        """How many sessions ours is connected to."""

        def peers() -> Rows:
            try:
                return single(0.0 if self._closed else float(len(self._session.info.transports())))
            except zenoh.ZError:
                return single(0.0)

        return [Measure.called("thermogate_zenoh_peers", peers)]

    def await_subscriber(self, timeout: float) -> bool:
        """Wait at most `timeout` s until every zone's forecast has a subscriber; whether they have."""
        deadline = time.monotonic() + timeout
        forecasts = [publisher for key, publisher in tuple(self._publishers.items()) if key.endswith("/forecast")]
        while not self._closed:
            try:
                if all(_matches(publisher) for publisher in forecasts):
                    return True
            except zenoh.ZError:
                # A close in another thread undeclares the publishers under this question.
                if not self._closed:
                    raise
            if time.monotonic() >= deadline:
                return False
            time.sleep(_POLL_SECONDS)
        return False

    def close(self) -> None:
        """Undeclare everything and close the session, within a second; safe to call twice."""
        if self._closed:
            return
        self._closed = True
        closing = threading.Thread(target=self._undeclare, name="zenoh-close", daemon=True)
        closing.start()
        closing.join(_CLOSE_SECONDS)
        if closing.is_alive():
            _log.warning("the Zenoh session did not close within %g s; left to the end of the process", _CLOSE_SECONDS)

    def _base(self, zone: str) -> str:
        return f"thermogate/{self._site}/{zone}"

    def _put(self, key: str, payload: bytes) -> None:
        publisher = self._publishers.get(key)
        if publisher is None or self._closed:
            # A reload has removed the zone under its last step.
            return
        self._last[key] = payload
        try:
            publisher.put(payload)
        except zenoh.ZError as error:
            # A close in another thread may undeclare the publisher under this put.
            if not self._closed:
                raise ServiceError(f"[zenoh]: {key} cannot be published ({first_line(error)})") from error

    def _questioned(self, key: str, zone: str | None, topic: str) -> Any:
        """A queryable for a question. Zenoh's thread is not kept waiting: it is answered when there is an answer."""

        def asked(query: zenoh.Query) -> None:
            if self._answering is None or self._closed:
                query.drop()
            elif self._waiting.acquire(blocking=False):
                payload = b"" if query.payload is None else query.payload.to_bytes()
                self._answering(Question(zone, topic, _parameters(query), payload), partial(reply, query))
            else:
                _refuse(query, f"more than {MOST_QUESTIONS} questions wait for their answers; ask again later")

        def reply(query: zenoh.Query, answer: Reply) -> None:
            self._waiting.release()
            with query:
                try:
                    if answer.good:
                        query.reply(key, answer.content, encoding=zenoh.Encoding.APPLICATION_JSON)
                    else:
                        query.reply_err(answer.content, encoding=zenoh.Encoding.APPLICATION_JSON)
                except zenoh.ZError as error:
                    _log.debug("while answering on %s: %s", key, error)

        # Of several that know all of it, such as the gateways of a fleet, the nearest answers.
        return self._session.declare_queryable(key, zenoh.handlers.Callback(asked, indirect=False), complete=True)

    def _answer(self, query: zenoh.Query) -> None:
        """Reply with the last value of every key that is asked for; parameters, of which there are none, are
        refused."""
        unknown = [name for name, _ in _parameters(query)]
        if unknown:
            questions = ", ".join(QUESTIONS)
            _refuse(query, f"parameter '{unknown[0]}' is not known on {query.key_expr}; {questions} take parameters")
            return
        with query:
            for key, payload in tuple(self._last.items()):
                if query.key_expr.intersects(key):
                    query.reply(key, payload, encoding=zenoh.Encoding.APPLICATION_JSON)

    def _undeclare(self) -> None:
        _give_up([one.undeclare for declared in self._declared.values() for one in declared])
        _give_up([self._session.close])


def _give_up(ends: Iterable[Callable[[], None]]) -> None:
    for end in ends:
        try:
            end()
        except zenoh.ZError as error:
            _log.debug("while closing Zenoh: %s", error)


def _parameters(query: zenoh.Query) -> list[tuple[str, str]]:
    """Names and values, `level=0.5|0.95` as two; without those of Zenoh itself, which begin with an underscore."""
    found = []
    for part in str(query.parameters).split(";"):
        name, _, values = part.partition("=")
        if name and not name.startswith("_"):
            found += [(name, value) for value in values.split("|")]
    return found


def _refuse(query: zenoh.Query, sentence: str) -> None:
    problem = {"type": "about:blank", "title": "Bad Request", "status": 400, "detail": sentence}
    with query, suppress(zenoh.ZError):
        query.reply_err(json.dumps(problem), encoding=zenoh.Encoding.APPLICATION_JSON)


class _AddressInUse(ServiceError):
    """An address to listen at is another process's."""


def _opening_failed(table: SessionConfig, text: str) -> ServiceError:
    """Why the session did not open, of which Zenoh says `text`, and the remedy."""
    if "in use" in text:
        return _AddressInUse(
            f"zenoh.listen: an address of {', '.join(table.listen)} is in use by another process; "
            "choose another port, stop that process, or do without Zenoh (zenoh.enabled = false)"
        )
    if table.mode == "client":
        if refused := refusal(table):
            return ServiceError(f"zenoh.connect: {refused}")
        where = ", ".join(table.connect) or "nothing"
        return ServiceError(
            f"zenoh.connect: no Zenoh router answers at {where}; start it or correct the address ({text})"
        )
    return ServiceError(f"[zenoh]: the session cannot be opened ({text}); check mode, listen and connect")


def _matches(publisher: zenoh.Publisher) -> bool:
    status = publisher.matching_status
    # Declared as bool, but it is a MatchingStatus, which is always true.
    return bool(getattr(status, "matching", status))


def _open(table: ZenohConfig, site: str) -> Publisher | None:
    """The publisher that `table` asks for. A site whose configuration says nothing of Zenoh starts without it where
    the usual address is in use, as by another site that is tried on the same machine."""
    if not table.enabled:
        return None
    try:
        return Publisher.open(table, site)
    except _AddressInUse as error:
        if table.model_fields_set:
            raise
        _log.warning("%s; nothing is published on Zenoh", error)
        return None


KIND = SinkKind("zenoh", ZenohConfig, _open)
