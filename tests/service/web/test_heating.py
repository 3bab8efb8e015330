"""Questions about heating over REST: when to start, how much, what another plan changes; and what is refused."""

from typing import Any

import numpy as np
import pytest
from fastapi import FastAPI
from support.http_client import get, post, problem
from support.refused import assert_refused, refusals
from support.site_of_rooms import Room
from support.thermostat_house import recorded

from service.records.outlook import Surroundings
from service.records.series import COLUMNS, Series
from service.records.trust import HorizonTrust, Trust
from service.zone.zone import Zone

DAYS = 2
ROOMS = {
    "house": Room("ekf", "tite", samples=288 * DAYS, told=True),
    "twin": Room("ekf", "tite", samples=288 * DAYS, told=True, surroundings=Surroundings({"T_set": (5.0, 30.0)})),
    "untold": Room("ekf", samples=20),
    "new": Room(samples=0),
}


def test_preheat_by_a_time_of_day(app: FastAPI) -> None:
    answer = get(app, "/zones/house/preheat?target=20.5&by=06:30")
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert (found["schema"], found["site"], found["zone"]) == (1, "htwg", "house")
    assert found["by"] == "1970-01-03T06:30:00Z"
    assert found["start"] is None or found["issue_time"] <= found["start"] < found["by"]
    assert 0.0 <= found["reached"] <= 1.0
    assert found["temperature"]["lower"] <= found["temperature"]["mean"] <= found["temperature"]["upper"]
    assert get(app, "/zones/house/preheat?target=20.5&by=1970-01-03T07:30:00%2B01:00").json() == found


def test_parameters_tell_the_law_of_the_thermostat(app: FastAPI) -> None:
    (law,) = get(app, "/zones/house/parameters").json()["thermostat"]
    assert (law["channel"], law["side"], law["law"]) == ("u_heat", "heating", "proportional")
    assert law["power"]["lower"] < law["power"]["mean"] < law["power"]["upper"]
    assert get(app, "/zones/untold/parameters").json()["thermostat"] == []


def test_a_room_answers_from_its_history_and_its_worker(
    site: tuple[FastAPI, dict[str, Zone]], monkeypatch: pytest.MonkeyPatch
) -> None:
    app, zones = site
    outputs, inputs, setpoints = recorded(DAYS, 300)
    y, times = outputs[:, 0], 300 * np.arange(len(outputs))
    means = dict.fromkeys(COLUMNS, np.full(len(y), np.nan)) | {"y": y, "setpoint": setpoints}
    asked: list[tuple[int, int]] = []

    async def series(start: int, end: int, points: int) -> Series:
        asked.append((end - start, points))
        return Series(300, times, means, y, y, y, y, inputs)

    monkeypatch.setattr(zones["house"], "series", series)
    answer = get(app, "/zones/house/room?days=2")
    assert answer.status_code == 200, answer.text
    assert asked == [(2 * 86400, 97)]
    found = answer.json()
    assert found["days"] == DAYS
    told = {one["about"]: one for one in found["answers"]}
    assert told.keys() >= {"comfort", "heat_loss", "cooling", "heating", "other_heat", "energy"}
    assert told["heat_loss"]["value"] > 0.0
    assert "below the set-point" in told["comfort"]["sentence"]
    assert (len(found["sun"]), len(found["people"])) == (24, 24)
    assert len(found["to_do"]) <= 3
    german = get(app, "/zones/house/room?days=2&language=de").json()
    assert german["answers"][0]["sentence"].startswith(("Behaglich: ", "Oft zu "))
    assert [one["value"] for one in german["answers"]] == [one["value"] for one in answer.json()["answers"]]
    assert get(app, "/zones/house/room?language=fr").status_code == 422
    assert get(app, "/zones/new/room").status_code == 503
    assert get(app, "/zones/house/room?days=29").status_code == 422


def test_demand_and_what_if(app: FastAPI) -> None:
    demand = post(app, "/zones/house/demand", {"horizon": "3h", "T_set": {"step": "1h", "values": [17, 19, 21]}}).json()
    assert demand["planned"] is True
    assert [hour["begin"] for hour in demand["hours"]] == [f"1970-01-03T0{hour}:00:00Z" for hour in range(3)]
    compared = post(
        app,
        "/zones/house/what-if",
        {"horizon": "6h", "plans": [{"name": "warm", "T_set": 21}, {"name": "cool", "T_set": 18}], "price": 0.3},
    ).json()
    (difference,) = compared["differences"]
    assert difference["energy"]["upper"] < 0.0
    assert difference["cost"]["mean"] == pytest.approx(0.3 * difference["energy"]["mean"])
    # A plan alone comes to what the demand under it is.
    alone = post(app, "/zones/house/demand", {"horizon": "6h", "T_set": 21}).json()["total"]
    assert compared["plans"][0]["energy"] == pytest.approx(alone, rel=1e-9)


def test_the_demand_of_a_site_adds_up_the_zones_that_can_say(app: FastAPI) -> None:
    body = {"horizon": "6h", "T_set": 20.0}
    found = post(app, "/demand", body).json()
    rows = {row["zone"]: row for row in found["zones"]}
    assert rows.keys() == ROOMS.keys()
    assert found["total"]["mean"] == pytest.approx(rows["house"]["total"]["mean"] + rows["twin"]["total"]["mean"])
    spread = rows["house"]["total"]["upper"] - rows["house"]["total"]["lower"]
    assert found["total"]["upper"] - found["total"]["lower"] < 1.8 * spread
    assert rows["untold"]["total"] is None
    assert "no set-point was measured yet" in rows["untold"]["reason"]
    assert "no forecast now" in rows["new"]["reason"]
    (one,) = post(app, "/demand", body | {"zones": ["twin"]}).json()["zones"]
    assert one == rows["twin"]


@refusals("heating")
def test_what_cannot_be_answered_is_refused_in_a_sentence(app: FastAPI, row: dict[str, Any]) -> None:
    assert_refused(app, row)


def test_a_zone_that_is_not_trusted_refuses(
    site: tuple[FastAPI, dict[str, Zone]], monkeypatch: pytest.MonkeyPatch
) -> None:
    app, zones = site
    told = Trust(0, (HorizonTrust(86400, "untrusted", "its forecasts were worse than persistence", 0),))
    known = zones["house"].now()
    monkeypatch.setattr(zones["house"], "now", lambda: known._replace(trust=told))
    detail = problem(get(app, "/zones/house/preheat?target=21&by=06:30"), 409)["detail"]
    assert detail == "zone 'house' is not trusted 24 h ahead: its forecasts were worse than persistence"
