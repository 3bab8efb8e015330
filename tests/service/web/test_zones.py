"""The routes under /zones."""

from __future__ import annotations

import json
from dataclasses import asdict
from datetime import datetime
from typing import Any

import pytest
from fastapi import FastAPI
from prometheus_client import CollectorRegistry
from support import schemas
from support.fake_zones import PERIOD, START, FakeZone, broken, running, waiting
from support.http_client import get, post, problem, request
from support.refused import assert_refused, refusals

from service.publish.payloads import FanPayload, ForecastPayload
from service.records.history import HistoryRow
from service.records.record import document, document_of
from service.web.app import create_app


@pytest.fixture
def zones() -> dict[str, FakeZone]:
    zones = [running("living", levels=(0.5, 0.95)), waiting("attic"), broken("cellar")]
    return {zone.id: zone for zone in zones}


@pytest.fixture
def app(zones: dict[str, FakeZone]) -> FastAPI:
    return create_app("htwg", zones, CollectorRegistry())


@pytest.mark.parametrize("limit", [1, 2, 3, 4])
def test_pages_of_zones_are_all_zones_once(app: FastAPI, limit: int) -> None:
    found, after = [], ""
    while True:
        told = get(app, f"/zones?limit={limit}{after}").json()
        page = [zone["id"] for zone in told["zones"]]
        assert len(page) <= limit
        found += page
        if told["next"] is None:
            break
        assert told["next"] == page[-1]
        after = f"&after={page[-1]}"
    assert found == ["living", "attic", "cellar"]
    assert get(app, "/zones").json()["next"] is None


def test_a_page_after_a_zone_that_is_gone_is_refused(app: FastAPI) -> None:
    assert "there is no zone 'garage' any more" in problem(get(app, "/zones?limit=2&after=garage"), 422)["detail"]


def test_the_standing_forecast_is_the_published_one_to_the_last_digit(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    answer = get(app, "/zones/living/forecast")
    published = document(ForecastPayload.of(zones["living"].updates[-1]), "htwg", "living")
    assert answer.content == published
    assert answer.headers["content-type"] == "application/json"
    assert zones["living"].asked == [], "nothing was computed"


def test_published_levels_are_not_computed_again(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    told = get(app, "/zones/living/forecast?level=.95&level=0.5&level=.95").json()
    assert [interval["level"] for interval in told["intervals"]] == [0.95, 0.5]
    assert zones["living"].asked == []


def test_other_levels_come_from_the_zone(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    told = get(app, "/zones/living/forecast?level=.8&level=.95").json()
    assert [interval["level"] for interval in told["intervals"]] == [0.8, 0.95]
    assert zones["living"].asked == [("fan", 0, (0.8, 0.95), {})]
    assert "fan" not in told
    schemas.check(told, document_of(ForecastPayload))


def test_a_horizon_gives_the_standing_forecast_and_every_step_after(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    told = get(app, "/zones/living/forecast?horizon=6h").json()
    schemas.check(told, document_of(FanPayload))
    assert zones["living"].asked == [("fan", 72, (0.5, 0.95), {})]
    assert len(told["fan"]) == 73
    assert told["fan"][0]["valid_time"] == told["valid_time"]
    first, last = (datetime.fromisoformat(step["valid_time"]) for step in (told["fan"][0], told["fan"][-1]))
    assert (last - first).total_seconds() == told["horizon_s"] == 6 * 3600
    assert told["planned"] == []


@pytest.mark.parametrize("state", ["stalled", "failed"])
def test_a_zone_that_cannot_vouch_for_its_forecast_says_bad(
    app: FastAPI, zones: dict[str, FakeZone], state: str
) -> None:
    zones["living"].state = state
    assert get(app, "/zones/living/forecast").json()["quality"] == "bad"


@pytest.mark.parametrize("query", ["horizon=1h", "level=.3"])
def test_a_stalled_zone_computes_nothing_new(app: FastAPI, zones: dict[str, FakeZone], query: str) -> None:
    zones["living"].state, zones["living"].reason = "stalled", "T_out is 1500 s old"
    answer = get(app, f"/zones/living/forecast?{query}")
    assert problem(answer, 503)["detail"] == "zone 'living' has no forecast now (stalled): T_out is 1500 s old"
    assert "retry-after" in answer.headers


def test_planned_inputs_reach_the_zone_as_full_rows(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    heat = [2000.0, 1500, 0.0, 0.0, 500.5, 0.0]
    body = {"horizon": "30min", "levels": [0.9], "inputs": {"u_heat": heat, "T_out": -3}}
    told = post(app, "/zones/living/forecast", body).json()
    schemas.check(told, document_of(FanPayload))
    assert zones["living"].asked == [("fan", 6, (0.9,), {"u_heat": heat, "T_out": [-3.0] * 6})]
    assert told["planned"] == ["u_heat", "T_out"]
    assert len(told["fan"]) == 7


def test_history_is_bounded_and_complete(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    url = "/zones/living/history?start=2025-05-03T02:05:00%2B02:00&end=2025-05-03T00:10:00Z&limit=5"
    told = get(app, url).json()
    assert zones["living"].asked == [("history", START + PERIOD, START + 2 * PERIOD, 5)]
    (row,) = told["rows"]
    expected = HistoryRow.of(zones["living"].updates[1])
    unknown = dict.fromkeys(("gain_lower", "gain_median", "gain_upper", "setpoint"))
    assert row == asdict(expected) | {"time": "2025-05-03T00:05:00Z"} | unknown
    assert (told["output"], told["unit"], told["period_s"]) == ("T_air", "degC", 300.0)


def test_a_fraction_of_a_second_rounds_up(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    get(app, "/zones/living/history?start=2025-05-03T00:00:00.5Z")
    assert zones["living"].asked == [("history", START + 1, None, 1000)]


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", ""),
        ("GET", "/forecast"),
        ("GET", "/forecast?horizon=1h"),
        ("POST", "/forecast"),
        ("GET", "/parameters"),
        ("GET", "/history"),
    ],
)
def test_an_unknown_zone_is_404_with_the_known_ones(app: FastAPI, method: str, path: str) -> None:
    body = {"json": {"horizon": "1h"}} if method == "POST" else {}
    told = problem(request(app, method, f"/zones/livin{path}", **body), 404)
    assert told["zones"] == ["living", "attic", "cellar"]
    assert told["zone_count"] == 3
    assert told["detail"] == "there is no zone 'livin'; the zones are living, attic, cellar"


def test_of_many_zones_a_404_names_few() -> None:
    zones = {f"room-{k}": running(f"room-{k}") for k in range(500)}
    app = create_app("htwg", zones, CollectorRegistry())
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


def test_the_longest_horizon_is_allowed(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    assert get(app, "/zones/living/forecast?horizon=7d").status_code == 200
    assert zones["living"].asked[0][1] == 2016


def test_a_body_that_is_not_json(app: FastAPI) -> None:
    headers = {"Content-Type": "application/json"}
    answer = request(app, "POST", "/zones/living/forecast", content='{"horizon": ', headers=headers)
    assert problem(answer, 422)["errors"][0].startswith("the body is not JSON")
    answer = request(app, "POST", "/zones/living/forecast", content=json.dumps({"horizon": "1h"}))
    assert "Content-Type: application/json" in problem(answer, 422)["errors"][0]
    answer = request(app, "POST", "/zones/living/forecast")
    assert problem(answer, 422)["errors"] == ["the JSON body is missing"]
