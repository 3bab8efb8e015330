"""Posting readings over REST: who may, what is read, and what is refused before it is looked at."""

import asyncio
import gzip
import json
import tracemalloc
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI
from support.fake_zones import running
from support.http_client import get, problem, request, scope
from support.waiting import until

from adapters.http.posted import Posted
from adapters.reading import Fault, Quality
from service.config.http import HttpConfig, LimitsConfig
from service.errors import JournalError
from service.publish.metrics import Metrics
from service.records.receipt import Receipt
from service.web import readings
from service.web.app import create_app
from service.web.keys import KeyRing, create_key
from service.web.limits import POSTS, table
from service.web.models import PostedReadings
from service.web.readings import MAX_VALUES
from service.web.server.in_process import ask
from service.web.server.refusal import MOST_SENTENCES, RequestRefused
from service.web.site import Backend

UNREAD = json.loads(Path(__file__).with_name("unread.json").read_text(encoding="utf-8"))
OF_ONE, WAITING = table(LimitsConfig())[POSTS][2:4]

JSON = "application/json"
SENML = "application/senml+json"
LINES = "text/plain"
GZIP = {"Content-Encoding": "gzip"}


class Desk:
    """Takes everything and remembers it; waits for `open` if it is told to, or fails."""

    def __init__(self) -> None:
        self.asked = 0
        self.taken: list[tuple[list[Posted], str | None]] = []
        self.failure: Exception | None = None
        self.open: asyncio.Event | None = None

    async def take(self, posted: Sequence[Posted], zone: str | None) -> Receipt:
        self.asked += 1
        if self.open is not None:
            await self.open.wait()
        if self.failure is not None:
            raise self.failure
        self.taken.append((list(posted), zone))
        return Receipt(len(posted), 1, 3, Counter({Fault.OUT_OF_ORDER: 2}), 4, ("cpu idle",))


DESK = Desk()


@pytest.fixture(autouse=True)
def desk() -> Desk:
    """The desk of every application, as new."""
    DESK.__init__()
    return DESK


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("keys") / "keys.json"


@pytest.fixture(scope="module")
def key(file: Path) -> str:
    return create_key(file, "telegraf", "write")


@pytest.fixture(scope="module")
def app(file: Path) -> FastAPI:
    return served(file)


def served(file: Path, zone: str = "living", **limits: int) -> FastAPI:
    """An application with limits, that of the body 4 MB."""
    zones = {name: running(name) for name in (zone, "bedroom")}
    http = HttpConfig.model_validate({"limits": {"body": 4_000_000, **limits}}, context={"folder": "/"})
    keys = KeyRing(file, required=False)
    return create_app("htwg", zones, Metrics(zones).registry, keys=keys, backend=Backend(take=DESK.take), http=http)


def post(
    app: FastAPI, body: bytes, key: str, kind: str = LINES, path: str = "/readings", **more: str
) -> httpx.Response:
    headers = {"Authorization": f"Bearer {key}", "Content-Type": kind, **more}
    return request(app, "POST", path, content=body, headers={name: text for name, text in headers.items() if text})


def entries(*found: object) -> bytes:
    return json.dumps({"readings": found}).encode()


def test_three_formats(app: FastAPI, desk: Desk, key: str) -> None:
    entry = {"channel": "T_i", "value": 21.5, "time": "2026-01-15T13:00:00+01:00", "unit": "degC"}
    nothing = {"channel": "T_out", "value": None, "quality": "uncertain"}
    for body, kind in (
        (entries(entry, nothing), f"{JSON}; charset=utf-8"),
        (b'[{"n": "T_i", "u": "Cel", "v": 21.5, "t": 1768478400}]', SENML),
        (b"living T_i=21.5 1768478400", f"{LINES}; charset=utf-8"),
    ):
        assert post(app, body, key, kind, "/zones/living/readings?precision=s").status_code == 200
    first, second, third = (posted for posted, zone in desk.taken if zone == "living")
    assert first[0] == second[0] == Posted("T_i", 21.5, 1768478400.0, unit="degC")
    assert first[1] == Posted("T_out", Fault.NOT_AVAILABLE, quality=Quality.UNCERTAIN)
    assert third == [Posted("living", 21.5, 1768478400.0, "T_i", {})]


def test_the_documented_example_is_a_valid_request(app: FastAPI, desk: Desk, key: str) -> None:
    described = app.openapi()["paths"]["/readings"]["post"]["requestBody"]["content"]
    examples = {kind: content["schema"].get("examples") for kind, content in described.items()}
    examples[JSON] = PostedReadings.model_json_schema()["examples"]
    for kind, (example, *_) in examples.items():
        body = example if isinstance(example, str) else json.dumps(example)
        assert post(app, body.encode(), key, kind).status_code == 200
    assert sorted(len(posted) for posted, _ in desk.taken) == [1, 1, 2]


@pytest.mark.parametrize("path", ["/readings", "/zones/living/readings"])
def test_posting_needs_a_key_for_it_even_where_reading_is_open(tmp_path: Path, desk: Desk, path: str) -> None:
    file = tmp_path / "keys.json"
    app = served(file)
    assert get(app, "/zones").status_code == 200
    answer = request(app, "POST", path, content=b"a b=1", headers={"Content-Type": LINES})
    assert "needs an API key" in problem(answer, 401)["detail"]
    problem(post(app, b"a b=1", create_key(file, "reader", "read"), path=path), 403)
    for allowed in ("admin", "write"):
        assert post(app, b"a b=1", create_key(file, allowed, allowed), path=path).status_code == 200
    assert len(desk.taken) == 2


def test_a_key_for_writing_does_nothing_else_and_for_one_zone_in_no_other(
    app: FastAPI, desk: Desk, key: str, file: Path
) -> None:
    headers = {"Authorization": f"Bearer {key}"}
    for path in ("/zones", "/zones/living", "/zones/living/forecast", "/metrics", "/readyz"):
        assert "key for read" in problem(get(app, path, headers=headers), 403)["detail"]
    for path in ("/zones/living/forecast", "/admin/reload"):
        problem(request(app, "POST", path, json={"horizon": "10min"}, headers=headers), 403)
    assert get(app, "/healthz", headers=headers).status_code == 200
    problem(post(app, b"a b=1", key, path="/zones/attic/readings"), 404)
    tenant = create_key(file, "tenant", "write", ["living"])
    assert post(app, b"living T_i=1", tenant, path="/zones/living/readings").status_code == 200
    problem(post(app, b"bedroom T_i=1", tenant, path="/zones/bedroom/readings"), 404)
    assert "all zones" in problem(post(app, b"living T_i=1", tenant), 403)["detail"]
    assert len(desk.taken) == 1


@pytest.mark.parametrize(
    ("body", "kind", "status", "sentence"),
    [
        *((body.encode(), *told) for body, *told in UNREAD),
        (b"\xff", LINES, 400, "not text in UTF-8"),
        (b"[" * 100_000, JSON, 422, "the body is not JSON"),
        (b'[{"n": "a", "' + b"x" * 10_000 + b'_": 1}]', SENML, 422, 'the body has the field "xxx'),
        (entries({"channel": "a", "value": 10**400}), JSON, 422, "field 'readings[0].value'"),
    ],
)
def test_what_cannot_be_read_is_refused_as_a_whole(
    body: bytes, kind: str, status: int, sentence: str, app: FastAPI, desk: Desk, key: str
) -> None:
    assert sentence in problem(post(app, body, key, kind), status)["detail"]
    assert not desk.taken


def test_what_cannot_be_read_is_counted_by_kind_and_logged_once(
    file: Path, key: str, caplog: pytest.LogCaptureFixture
) -> None:
    app = served(file)
    for _ in range(3):
        post(app, b"a b=1\nc d", key)
        post(app, b"{", key, JSON)
        post(app, b"[1]", key, SENML)
        post(app, b"\xff", key)
        post(app, b"a b=1", key, "application/xml")
        post(app, b"a b=1\n" * (MAX_VALUES + 1), key)
    kinds = ("line_protocol", "json", "senml", "encoding", "media_type", "size")
    assert app.state.malformed_posts == dict.fromkeys(kinds, 3)
    said = [record.getMessage() for record in caplog.records if "cannot be read" in record.getMessage()]
    assert len(said) == len(kinds), said
    assert said[0].startswith("a post with the API key 'telegraf' cannot be read: line 2: a field is key=value")
    assert said[0].endswith("(line_protocol: 1 so far)")


def test_an_answer_lists_few_mistakes(app: FastAPI, desk: Desk, key: str) -> None:
    wrong = [{"channel": "", "value": "x"} for _ in range(1000)]
    document = problem(post(app, entries({"channel": "a", "value": 1}, *wrong), key, JSON), 422)
    assert len(document["errors"]) == MOST_SENTENCES + 1
    assert document["errors"][-1].endswith(" more")
    assert not desk.taken


@pytest.mark.parametrize(
    ("body", "kind"),
    [
        (b'{"readings": [' + b"1," * MAX_VALUES + b"1]}", JSON),
        (b"[" + b"{}," * MAX_VALUES + b"{}]", SENML),
        (b"a b=1\n" * (MAX_VALUES + 1), LINES),
    ],
)
def test_too_many_values_are_refused_before_they_are_looked_at(
    body: bytes, kind: str, app: FastAPI, desk: Desk, key: str
) -> None:
    detail = problem(post(app, body, key, kind), 413)["detail"]
    assert f"at most {MAX_VALUES} values" in detail
    assert "metric_batch_size" in detail
    assert not desk.taken


def many(first: dict[str, Any]) -> bytes:
    """SenML of nearly as many values as are taken, behind `first`."""
    return json.dumps([first] + [{"n": str(k), "v": 1} for k in range(19_990)]).encode()


@pytest.mark.parametrize(
    ("body", "kind"),
    [
        (many({"bn": "x" * 500_000}), SENML),
        (many({"bu": "x" * 500_000}), SENML),
        (many({"bn": ["x" * 500_000]}), SENML),
        (many({"bn": "\U0001f321" * 200}), SENML),
        (b"[" + b"[]," * 300_000 + b"[]]", SENML),
        (b"a" + b",a=b" * 250_000 + b" a=1", LINES),
        (b"a b=1" + b",b=1" * 250_000, LINES),
    ],
    ids=["name", "unit", "no text", "wide", "lists", "tags", "fields"],
)
def test_what_is_decoded_is_bounded_and_not_only_what_arrives(body: bytes, kind: str) -> None:
    """At most 30 times the largest body, whatever is in it."""
    limit, headers = 1_048_576, {"content-type": kind, "content-encoding": "gzip"}
    assert len(body) <= limit
    packed = gzip.compress(body)
    tracemalloc.start()
    try:
        with suppress(RequestRefused):
            readings.read(readings.unpacked(packed, headers, limit), headers, "ns")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 30 * limit, f"{peak / limit:.0f} times"


def test_a_key_that_posts_too_much_waits_and_no_other_does(
    file: Path, key: str, caplog: pytest.LogCaptureFixture
) -> None:
    app, greedy = served(file, post_rate=1000), create_key(file, "greedy", "write")
    body = gzip.compress(b"a b=1\n" * 10_500)
    assert post(app, body, greedy, **GZIP).status_code == 200, "a minute's worth at once"
    refused = post(app, b"a b=1", greedy)
    assert "more than 1000 bytes/s" in problem(refused, 429)["detail"]
    assert 0 < int(refused.headers["retry-after"]) <= 60
    assert post(app, b"a b=1", key).status_code == 200
    assert "key greedy posts more than 1000 bytes/s" in caplog.text


def test_a_packed_body(app: FastAPI, desk: Desk, key: str) -> None:
    good = gzip.compress(b"a b=1")
    assert post(app, good, key, **GZIP).status_code == 200
    detail = problem(post(app, gzip.compress(b"\n" * 5_000_000), key, **GZIP), 413)["detail"]
    assert detail == "the body is larger than 4000000 bytes when it is unpacked"
    for wrong in (b"a b=1", good[:-4], good + b"more"):
        problem(post(app, wrong, key, **GZIP), 400)
    problem(post(app, b"a b=1", key, **{"Content-Encoding": "br"}), 415)
    twice = b'{"readings": [], "readings": []}'
    problem(post(app, gzip.compress(twice), key, JSON, **GZIP), 400)
    problem(post(app, twice, key, "Application/Json", **{"Content-Encoding": "identity"}), 400)
    assert len(desk.taken) == 1


def sent_in_pieces(key: str, path: str, *messages: dict[str, Any]) -> tuple[Any, Any, Callable[..., Any]]:
    """What an application is called with for a post in chunks: `messages`, and nothing after them."""
    came = list(messages)

    async def receive() -> Any:
        return came.pop(0) if came else await asyncio.Event().wait()

    async def send(message: Any) -> None:
        pass

    headers = {"Authorization": f"Bearer {key}", "Content-Type": LINES, "Transfer-Encoding": "chunked"}
    return scope("POST", path, headers), receive, send


BEGUN = {"type": "http.request", "body": b"#", "more_body": True}


async def test_one_tenants_key_does_not_stop_the_readings_of_another(
    app: FastAPI, desk: Desk, key: str, file: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Requests that never end, and as many whole ones as a key may have waiting for a journal that hangs."""
    other = create_key(file, "honest", "write")

    async def one(secret: str) -> int:
        headers = [(b"host", b"localhost"), (b"authorization", f"Bearer {secret}".encode())]
        body = entries({"channel": "a", "value": 1})
        return (await ask(app, "POST", "/readings", body=body, headers=headers)).status

    slow = [asyncio.create_task(app(*sent_in_pieces(key, "/readings", BEGUN))) for _ in range(50)]
    await asyncio.sleep(0)
    desk.open = asyncio.Event()
    greedy = [asyncio.create_task(one(key)) for _ in range(WAITING + 3)]
    await until(lambda: sum(task.done() for task in greedy) == 3)
    honest = asyncio.create_task(one(other))
    await until(lambda: desk.asked == OF_ONE + 1)
    assert not honest.done(), "it is with the journal, beside those of the other key"
    desk.open.set()
    answers = await asyncio.gather(*greedy)
    for task in slow:
        task.cancel()
    await asyncio.gather(*slow, return_exceptions=True)
    assert await honest == 200
    assert Counter(answers) == {200: WAITING, 429: 3}, "who posts faster than the journal writes waits, or is refused"
    told = {record.getMessage() for record in caplog.records if "refused" in record.getMessage()}
    assert told == {f"key telegraf has {WAITING} posts of readings open, and further ones are refused"}


def test_where_the_journal_fails_the_client_is_told_to_come_back(app: FastAPI, desk: Desk, key: str) -> None:
    desk.failure = JournalError("the journal /x failed (disk full); free space on its disk")
    answer = post(app, b"a b=1", key)
    assert "free space" in problem(answer, 503)["detail"]
    assert int(answer.headers["retry-after"]) > 0
    desk.failure = None
    assert post(app, b"a b=1", key).status_code == 200


@pytest.mark.parametrize("path", ["/readings", "/zones/living/readings"])
def test_a_client_that_goes_away_in_the_middle_of_a_body_is_no_failure(
    app: FastAPI, desk: Desk, key: str, path: str
) -> None:
    asyncio.run(app(*sent_in_pieces(key, path, BEGUN, {"type": "http.disconnect"})))
    assert desk.taken == []
