"""What one request may have in it, and how much of what is wrong with it is told."""

import asyncio
from collections.abc import Callable
from typing import Any

import httpx
import pytest
from fastapi import FastAPI, Response
from support.fake_zones import running
from support.http_client import post, problem, request
from support.tables import tabled

from service.publish.metrics import Metrics
from service.web.app import create_app
from service.web.server import bodies, in_process
from service.web.server.bodies import MAX_ITEMS, GatherBody
from service.web.server.refusal import LONGEST_SENTENCE, MOST_SENTENCES, RequestRefused

PLAN = "/zones/living/forecast"


@pytest.fixture(scope="module")
def app() -> FastAPI:
    zones = {zone.id: zone for zone in (running("living"), running("bedroom"))}
    return create_app("htwg", zones, Metrics(zones).registry)


def sent(app: FastAPI, body: bytes, **headers: str) -> httpx.Response:
    return request(app, "POST", PLAN, content=body, headers={"Content-Type": "application/json", **headers})


WRONG: dict[str, Callable[[int], dict[str, Any]]] = {
    "levels": lambda count: {"horizon": "1h", "levels": [2] * count},
    "planned values": lambda count: {"horizon": "1h", "inputs": {"u_heat": ["x"] * count}},
    "unknown fields": lambda count: {"horizon": "1h"} | {f"field{i}": i for i in range(count)},
    "unknown channels": lambda count: {"horizon": "1h", "inputs": {f"channel{i}": 1 for i in range(count)}},
    "nested": lambda count: {"horizon": [[0] * 10] * (count // 10)},
    "a long name": lambda count: {"x" * count: 1},
    "a long value": lambda count: {"horizon": "x" * count},
}


@pytest.mark.parametrize("case", WRONG)
@pytest.mark.parametrize("count", [5_000, 200_000])
def test_one_request_is_answered_in_few_sentences(app: FastAPI, case: str, count: int) -> None:
    answer = post(app, PLAN, WRONG[case](count))
    assert answer.status_code in (413, 422)
    document = problem(answer, answer.status_code)
    sentences = document.get("errors") or [document["detail"]]
    assert len(sentences) <= MOST_SENTENCES + 1
    assert max(map(len, sentences)) <= LONGEST_SENTENCE
    assert len(answer.content) < 2 * (MOST_SENTENCES + 2) * LONGEST_SENTENCE
    if (case, count) == ("unknown fields", 5_000):
        assert sentences[0] == "field 'field0' is not known; /docs lists the known ones"
        assert sentences[-1] == f"and {5_000 - MOST_SENTENCES} more"


@pytest.mark.parametrize(
    ("body", "status", "sentence"),
    [
        (b'{"horizon":"1h","levels":' + b"[" + b"0.5," * MAX_ITEMS + b"0.5]}", 413, f"more than {MAX_ITEMS} values"),
        (b'{"\\uDFFF":1}', 400, "half a character"),
        (b'{"horizon":"1h","inputs":{"\\udabc":1}}', 400, "half a character"),
        (b'{"horizon":"\\ud83d\\ude00"}', 422, "\N{GRINNING FACE}"),
        (b'{"horizon":"1h","horizon":"2h"}', 400, "twice; give it once"),
        (b'{"horizon":"1h","inputs":{"u":1,"u":2}}', 400, "twice; give it once"),
        ('{"horizon":"1h","inputs":{"\\udabc":1}}'.encode("utf-16"), 400, "half a character"),
        (b'{"horizon":"1h","inputs":{"\xed\xa0\x80":1}}', 400, "half a character"),
    ],
)
def test_odd_json_is_the_clients_mistake(app: FastAPI, body: bytes, status: int, sentence: str) -> None:
    assert sentence in problem(sent(app, body), status)["detail"]


@tabled
def test_no_header_spares_json_the_look_at_it(app: FastAPI, headers: dict[str, str]) -> None:
    twice, much = b'{"horizon":"1h","horizon":"2h"}', b'{"horizon":"1h","levels":[' + b"1," * MAX_ITEMS + b"1]}"
    assert (sent(app, twice, **headers).status_code, sent(app, much, **headers).status_code) == (400, 413)


@pytest.mark.parametrize("body", [b"[" * 19_000, b'{"a":' * 19_000, b"\xff\xfe", b'"\\ud800', b"1e400"])
def test_what_is_no_json_is_the_clients_mistake(app: FastAPI, body: bytes) -> None:
    assert sent(app, body).status_code in (400, 422)


def test_plans_have_names_of_their_own(app: FastAPI) -> None:
    for plans, status in (["one", "one"], 422), (["one", "two"], 200), (["", ""], 200):
        answer = post(app, "/forecasts", {"horizon": "1h", "plans": [{"name": name} for name in plans]})
        assert answer.status_code == status, answer.text


async def test_bodies_of_all_clients_together_find_room_or_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bodies, "AT_ONCE", 3)
    monkeypatch.setattr(bodies, "AT_ONCE_OF_ONE", 2)
    release = asyncio.Event()
    taken = 0

    async def application(scope: Any, receive: Any, send: Any) -> None:
        nonlocal taken
        try:
            await receive()
        except RequestRefused as refused:
            await refused.answer(scope, receive, send)
            return
        taken += 1
        await release.wait()
        await Response("done")(scope, receive, send)

    gate = GatherBody(application, limit=100)

    async def ask(client: str) -> int:
        return (await in_process.ask(gate, "POST", PLAN, body=b"x" * 100, state={"client": client})).status

    asked: list[asyncio.Task[int]] = []
    for client in ("greedy", "greedy", "greedy", "other", "other", "third"):
        before = taken
        asked.append(asyncio.create_task(ask(client)))
        while taken == before and not asked[-1].done():
            await asyncio.sleep(0)
    release.set()
    statuses = [*await asyncio.gather(*asked), await ask("greedy")]
    assert statuses == [200, 200, 429, 200, 503, 200, 200], "a third has its share all the same"


def test_a_body_that_no_route_reads_is_not_taken_in(app: FastAPI) -> None:
    asked = []

    async def body() -> Any:
        asked.append(1)
        yield b"x"

    for path in ("/healthz", "/zones", "/", "/openapi.json"):
        assert request(app, "POST", path, content=body()).status_code == 405
    assert not asked
