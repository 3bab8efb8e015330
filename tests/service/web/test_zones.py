"""The routes under /zones."""

from typing import Any

import pytest
from fastapi import FastAPI
from prometheus_client import CollectorRegistry
from support.fake_zones import START, FakeZone, broken, running, waiting
from support.http_client import get, problem, request
from support.refused import assert_refused, refusals

from service.web.app import create_app

SERVED: dict[str, FakeZone] = {}


@pytest.fixture(autouse=True)
def zones() -> dict[str, FakeZone]:
    """The zones that are served, as new."""
    made = [running("living", levels=(0.5, 0.95)), waiting("attic"), broken("cellar")]
    SERVED.update({zone.id: zone for zone in made})
    return SERVED


@pytest.fixture(scope="module")
def app() -> FastAPI:
    return create_app("htwg", SERVED, CollectorRegistry())


@pytest.mark.parametrize("limit", [1, 2, 3])
def test_pages_of_zones_are_all_zones_once(app: FastAPI, limit: int) -> None:
    found, after = [], ""
    while after is not None:
        told = get(app, f"/zones?limit={limit}" + after).json()
        page = [zone["id"] for zone in told["zones"]]
        assert len(page) <= limit
        assert told["next"] in (page[-1], None)
        found, after = found + page, told["next"] and f"&after={page[-1]}"
    assert found == ["living", "attic", "cellar"]
    assert get(app, "/zones").json()["next"] is None
    assert "there is no zone 'garage' any more" in problem(get(app, "/zones?limit=2&after=garage"), 422)["detail"]


def test_published_levels_are_not_computed_again(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    told = get(app, "/zones/living/forecast?level=.95&level=0.5&level=.95").json()
    assert [interval["level"] for interval in told["intervals"]] == [0.95, 0.5]
    assert zones["living"].asked == []


def test_a_zone_that_cannot_vouch_for_its_forecast_says_bad_and_computes_nothing_new(
    app: FastAPI, zones: dict[str, FakeZone]
) -> None:
    for state in ("failed", "stalled"):
        zones["living"].state, zones["living"].reason = state, "T_out is 1500 s old"
        assert get(app, "/zones/living/forecast").json()["quality"] == "bad"
    for query in ("horizon=1h", "level=.3"):
        answer = get(app, f"/zones/living/forecast?{query}")
        assert problem(answer, 503)["detail"] == "zone 'living' has no forecast now (stalled): T_out is 1500 s old"
        assert "retry-after" in answer.headers


def test_a_time_is_of_any_zone_and_its_fraction_of_a_second_rounds_up(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    get(app, "/zones/living/history?start=2025-05-03T02:00:00.5%2B02:00")
    assert zones["living"].asked == [("history", START + 1, None, 1000)]


def test_of_many_zones_a_404_names_few() -> None:
    app = create_app("htwg", {f"room-{k}": running(f"room-{k}") for k in range(500)}, CollectorRegistry())
    for answer in (
        get(app, "/zones/room"),
        request(app, "POST", "/forecasts", json={"horizon": "1h", "zones": ["room"], "plans": [{}]}),
    ):
        told = problem(answer, 404)
        assert told["zones"] == [f"room-{k}" for k in range(20)]
        assert told["zone_count"] == 500
        assert told["detail"].endswith("room-18, room-19 and 480 more, which GET /zones lists")
        assert len(told["detail"]) < 500


@refusals("zones")
def test_a_mistake_in_a_request_is_a_sentence_and_nothing_is_computed(
    app: FastAPI, zones: dict[str, FakeZone], row: dict[str, Any]
) -> None:
    assert_refused(app, row)
    assert zones["living"].asked == []


def test_a_body_that_is_not_json(app: FastAPI) -> None:
    json = {"Content-Type": "application/json"}
    for sent, sentence in (
        ({"content": '{"horizon": ', "headers": json}, "the body is not JSON"),
        ({"content": '{"horizon": "1h"}'}, "the body was not sent as JSON; set Content-Type: application/json"),
        ({}, "the JSON body is missing"),
    ):
        assert problem(request(app, "POST", "/zones/living/forecast", **sent), 422)["errors"][0].startswith(sentence)
