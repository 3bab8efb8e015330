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


@pytest.mark.parametrize(
    ("query", "sentence"),
    [
        ("level=1.5", "query parameter 'level[0]': a level lies between 0 and 1, such as 0.95, not 1.5"),
        ("level=0", "query parameter 'level[0]': a level lies between 0 and 1, such as 0.95, not 0"),
        ("level=nan", "query parameter 'level[0]': a level lies between 0 and 1, such as 0.95, not nan"),
        ("level=high", "query parameter 'level[0]' must be a valid number, not 'high'"),
        ("levels=.5", "query parameter 'levels' is not known; /docs lists the known ones"),
        ("horizon=soon", "query parameter 'horizon': \"soon\" is not a duration"),
        ("horizon=0s", "horizon 0s is not a whole number of the zone's periods of 5min; 5min would be"),
        ("horizon=12min", "horizon 12min is not a whole number of the zone's periods of 5min; 10min would be"),
        ("horizon=2017h", "at most 2016 are forecast at once, that is 7d"),
        ("&".join(f"level=.{i:03}" for i in range(1, 34)), "takes at most 32 values"),
    ],
)
def test_mistakes_in_a_forecast_query(app: FastAPI, query: str, sentence: str) -> None:
    told = problem(get(app, f"/zones/living/forecast?{query}"), 422)
    (found,) = told["errors"]
    assert sentence in found
    assert told["detail"] == found


def test_the_longest_horizon_is_allowed(app: FastAPI, zones: dict[str, FakeZone]) -> None:
    assert get(app, "/zones/living/forecast?horizon=7d").status_code == 200
    assert zones["living"].asked[0][1] == 2016


@pytest.mark.parametrize(
    ("query", "sentence"),
    [
        ("start=2025-05-03T00:00:00", "has no time zone; end it with Z"),
        ("start=2025-05-03", "has no time zone"),
        ("end=2025-05-03T00:00:00+02:00", "write + as %2B in a query"),
        ("start=1746230400", "is not an RFC 3339 time such as 2025-05-03T12:00:00Z"),
        ("limit=0", "query parameter 'limit' must be greater than or equal to 1, not '0'"),
        ("limit=many", "query parameter 'limit' must be a valid integer, not 'many'"),
        ("limit=1000000", "less than or equal to 20000"),
        ("since=2025-05-03T00:00:00Z", "query parameter 'since' is not known"),
    ],
)
def test_mistakes_in_a_history_query(app: FastAPI, query: str, sentence: str) -> None:
    (found,) = problem(get(app, f"/zones/living/history?{query}"), 422)["errors"]
    assert sentence in found


@pytest.mark.parametrize(
    ("body", "sentences"),
    [
        ({}, ["field 'horizon' is missing"]),
        ([1], ["the JSON body must be a valid dictionary"]),
        ({"horizon": "1h", "input": {}}, ["field 'input' is not known"]),
        ({"horizon": "1h", "levels": ["0.5"]}, ["field 'levels[0]' must be a valid number, not '0.5'"]),
        (
            {"horizon": "1h", "inputs": {"u_heat": "2 kW"}},
            ["field 'inputs.u_heat': give a finite number, one"],
        ),
        ({"horizon": "1h", "inputs": {"u_heat": True}}, ["field 'inputs.u_heat': give a finite number"]),
        ({"horizon": "1h", "inputs": {"u_heat": [1, None]}}, ["field 'inputs.u_heat': give a finite number"]),
        (
            {"horizon": "1h", "inputs": {"u_heat": [1.0] * 11}},
            ["has 11 values, but the horizon has 12 steps of 5min; give 12 values, or one number for all"],
        ),
        (
            {"horizon": "1h", "inputs": {"u_heat": [], "T_air": 20, "x": 1}},
            [
                "has 0 values",
                "'inputs.T_air' is not an input of this zone; its inputs are",
                "field 'inputs.x' is not an",
            ],
        ),
        ({"horizon": "7min"}, ["horizon 7min is not a whole number"]),
    ],
)
def test_mistakes_in_a_plan(app: FastAPI, zones: dict[str, FakeZone], body: Any, sentences: list[str]) -> None:
    found = problem(post(app, "/zones/living/forecast", body), 422)["errors"]
    assert len(found) == len(sentences)
    for sentence, text in zip(sentences, found, strict=True):
        assert sentence in text
    assert zones["living"].asked == []


def test_a_body_that_is_not_json(app: FastAPI) -> None:
    headers = {"Content-Type": "application/json"}
    answer = request(app, "POST", "/zones/living/forecast", content='{"horizon": ', headers=headers)
    assert problem(answer, 422)["errors"][0].startswith("the body is not JSON")
    answer = request(app, "POST", "/zones/living/forecast", content=json.dumps({"horizon": "1h"}))
    assert "Content-Type: application/json" in problem(answer, 422)["errors"][0]
    answer = request(app, "POST", "/zones/living/forecast")
    assert problem(answer, 422)["errors"] == ["the JSON body is missing"]
