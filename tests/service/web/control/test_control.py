"""What a controller asks over REST: models, trust, and forecasts of many zones under many plans."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from fastapi import FastAPI
from support import schemas
from support.http_client import post, problem
from support.refused import assert_refused, refusals
from support.site_of_rooms import Room, site_of

from adapters.reading import Quality
from service.errors import Away, RequestError
from service.forecast.engine import PartQuestion
from service.forecast.plan import Plan
from service.forecast.request import ForecastRequest, bound
from service.records.outlook import Surroundings
from service.records.record import document_of
from service.web.control import routes
from service.web.control.models import SiteForecastPayload
from service.web.limits import LARGE, Limiter
from service.zone.zone import Zone

ROOMS = {
    "rbpf": Room(surroundings=Surroundings({"u_heat": (0.0, 2000.0), "T_out": (-30.0, 45.0)})),
    "ekf": Room("ekf"),
    "ukf": Room("ukf"),
    "mkf": Room("mkf"),
    "arx": Room("arx"),
    "new": Room(samples=0),
}


def beside(room: str, estimator: str, **more: Any) -> Room:
    surroundings = Surroundings(neighbours={"T_adj": (room, "T_air")})
    return Room(estimator, "ecolar-6r4c", surroundings=surroundings, **more)


NEXT_DOOR = {
    "west": beside("east", "ekf", temperature=24.0),
    "east": beside("west", "ekf", temperature=16.0),
    "told": beside("west", "arx"),
}


@pytest.fixture(scope="module")
def coupled(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FastAPI]:
    with site_of(tmp_path_factory.mktemp("coupled"), NEXT_DOOR) as (made, _):
        yield made


@refusals("control")
def test_what_cannot_be_answered_is_refused_in_one_sentence(app: FastAPI, row: dict[str, Any]) -> None:
    assert_refused(app, row)


def asked(app: FastAPI, **body: Any) -> list[dict[str, Any]]:
    answer = post(app, "/forecasts", {"horizon": "6h"} | body)
    assert answer.status_code == 200, answer.text
    schemas.check(answer.json(), document_of(SiteForecastPayload, of_a_zone=False))
    return [{zone["zone"]: zone for zone in plan["zones"]} for plan in answer.json()["plans"]]


def test_many_zones_and_plans_are_forecast_in_one_request(app: FastAPI) -> None:
    off, on = asked(
        app,
        plans=[
            {"name": "off", "inputs": {"*": {"u_heat": 0.0}}},
            {"name": "on", "inputs": {"*": {"u_heat": 0.0}, "rbpf": {"u_heat": 2000.0}}},
        ],
    )
    assert list(off) == list(ROOMS)
    for name in ("rbpf", "ekf", "ukf", "mkf", "arx"):
        mean = off[name]["outputs"][0]["mean"]
        assert len(mean) == 73
        assert off[name]["problem"] is None
        # No other zone had another plan.
        assert (on[name]["outputs"][0]["mean"] == mean) is (name != "rbpf")
    assert on["rbpf"]["outputs"][0]["mean"][-1] > off["rbpf"]["outputs"][0]["mean"][-1] + 0.3
    assert "has no forecast now" in off["new"]["problem"]
    assert off["new"]["outputs"] == []


def test_a_zone_gives_the_same_numbers_whoever_asks(app: FastAPI) -> None:
    plan = {"u_heat": [1500.0 * (k % 24 < 12) for k in range(72)], "T_out": 3.0}
    for name in ("rbpf", "ekf", "mkf", "arx"):
        own = post(app, f"/zones/{name}/forecast", {"horizon": "6h", "levels": [0.8], "inputs": plan}).json()["fan"]
        (fans,) = asked(app, zones=[name], levels=[0.8], plans=[{"inputs": {name: plan}}])
        output = fans[name]["outputs"][0]
        for key in ("mean", "median", "sd"):
            assert output[key] == [step["outputs"][0][key] for step in own]
        assert output["upper"][0] == [step["outputs"][0]["intervals"][0]["upper"] for step in own]


def test_a_large_answer_is_made_in_turn_and_is_the_same(app: FastAPI, monkeypatch: pytest.MonkeyPatch) -> None:
    taken = []
    own = Limiter.turn
    monkeypatch.setattr(Limiter, "turn", lambda self, kind: taken.append(kind) or own(self, kind))
    body = {"horizon": "10min", "plans": [{"name": "one"}, {"name": "two"}]}
    small = post(app, "/forecasts", body)
    assert not taken
    monkeypatch.setattr(routes, "MANY_NUMBERS", 1)
    large = post(app, "/forecasts", body)
    assert taken == [LARGE]
    assert large.content == small.content
    assert [plan["name"] for plan in large.json()["plans"]] == ["one", "two"]


def test_work_per_request_is_bounded(app: FastAPI, site: tuple[FastAPI, dict[str, Zone]]) -> None:
    many = [{"name": str(index)} for index in range(64)]
    large = [{"inputs": {"*": {"u_heat": [1.0] * 1400}}}] * 64
    document = problem(post(app, "/forecasts", {"horizon": "5min", "plans": large}), 422)
    assert document["detail"] == "the plans have 537600 values; at most 500000 are read in one request"
    document = problem(post(app, "/forecasts", {"horizon": "7d", "plans": many}), 422)
    assert "at most 100000 are forecast in one request" in document["detail"]
    too_many = {"horizon": "1h", "plans": [{"inputs": {"rbpf": {"u_heat": [0.0] * 3000}}}]}
    assert "at most 2016 values" in problem(post(app, "/forecasts", too_many), 422)["detail"]
    # 1,000 rooms that are coupled with the one that is asked for are simulated for each plan.
    view = site[1]["rbpf"]
    alone = ForecastRequest([view], 3600.0, plans=[Plan()] * 8)
    assert bound(alone._replace(around=[view] * 1000)) == bound(alone)
    with pytest.raises(RequestError, match="and 1100 that are coupled with them with 8 plans are 105704 steps"):
        bound(alone._replace(around=[view] * 1100))


def test_scenarios_come_on_request_and_repeat(app: FastAPI) -> None:
    first, again = (asked(app, zones=["rbpf", "mkf", "ekf"], scenarios=30)[0] for _ in range(2))
    for name in ("rbpf", "mkf", "ekf"):
        output = first[name]["outputs"][0]
        off = np.abs(np.mean(output["scenarios"], axis=0) - output["mean"])
        assert (off < 6.0 * np.array(output["sd"]) / np.sqrt(30)).all()
        assert again[name]["outputs"][0]["scenarios"] == output["scenarios"]
    (refused,) = asked(app, zones=["arx"], scenarios=5)
    assert "has no scenarios" in refused["arx"]["problem"]


def test_rooms_next_door_are_simulated_together(coupled: FastAPI) -> None:
    (together,) = asked(coupled, horizon="24h", plans=[{"inputs": {"*": {"u_heat": 0.0}}}])
    (apart,) = asked(coupled, horizon="24h", plans=[{"inputs": {"*": {"u_heat": 0.0, "T_adj": 20.0}}}])
    for room, other in (("west", "east"), ("east", "west"), ("told", "west")):
        origin = together[room]["inputs"][1]
        assert (origin["channel"], origin["origin"], origin["source"]) == ("T_adj", "neighbour", other)
        assert apart[room]["inputs"][1]["origin"] == "plan"
        # A regression whose neighbour never changed has not learned what it does.
        changed = together[room]["outputs"][0]["mean"][-1] != apart[room]["outputs"][0]["mean"][-1]
        assert changed is (room != "told")
    # What a room was told of its neighbour is what the neighbour is then forecast to do.
    east = together["east"]["outputs"][0]["mean"][:-1]
    (told,) = asked(
        coupled, horizon="24h", zones=["west"], plans=[{"inputs": {"*": {"u_heat": 0.0}, "west": {"T_adj": east}}}]
    )
    assert np.allclose(told["west"]["outputs"][0]["mean"], together["west"]["outputs"][0]["mean"], atol=1e-2)
    # A neighbour that is not asked for is simulated all the same.
    (alone,) = asked(
        coupled, horizon="24h", zones=["west"], plans=[{"inputs": {"*": {"u_heat": 0.0}, "east": {"u_heat": 0.0}}}]
    )
    assert list(alone) == ["west"]
    assert alone["west"]["outputs"][0]["mean"] == together["west"]["outputs"][0]["mean"]


@pytest.mark.parametrize("simulated", [True, False])
def test_a_room_that_cannot_be_reached_does_not_take_the_others_forecasts(
    coupled: FastAPI, monkeypatch: pytest.MonkeyPatch, simulated: bool
) -> None:
    """Neither one that is away before the rooms are simulated together, nor one that is away after it."""
    whole = asked(coupled, horizon="6h", zones=["east"])[0]["east"]
    reach = Zone.ask

    async def unless_away(zone: Zone, question: Any) -> Any:
        if zone.id == "west" and not (simulated and isinstance(question, PartQuestion)):
            raise Away("shard-1 is being started; ask again in a moment")
        return await reach(zone, question)

    monkeypatch.setattr(Zone, "ask", unless_away)
    (found,) = asked(coupled, horizon="6h", zones=["west", "east"])
    assert found["east"]["problem"] is None
    assert len(found["east"]["outputs"][0]["mean"]) == len(whole["outputs"][0]["mean"])
    assert found["east"]["inputs"][1]["origin"] == ("neighbour" if simulated else "held")
    assert found["west"]["problem"] == "shard-1 is being started; ask again in a moment"
    # A neighbour that nobody asked for is not worth a word.
    (alone,) = asked(coupled, horizon="6h", zones=["east"])
    assert alone["east"]["problem"] is None


def test_a_forecast_that_no_measurement_would_be_believed_at_is_bad(app: FastAPI) -> None:
    (fans,) = asked(app, zones=["ekf"], plans=[{"inputs": {"ekf": {"u_heat": 1e6}}}])
    assert fans["ekf"]["quality"] == Quality.BAD
    body = {"horizon": "6h", "inputs": {"u_heat": 1e6}}
    assert post(app, "/zones/ekf/forecast", body).json()["quality"] == Quality.BAD
