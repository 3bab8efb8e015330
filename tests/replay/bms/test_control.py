"""The control surface: the truth, and faults on and off at run time."""

from typing import Any

import pytest
from support.bms_plant import Clock, ask, simulation, started
from support.tables import tabled


def test_the_state_is_the_truth() -> None:
    plant = simulation(Clock())
    (response,) = ask(plant, ("GET", "/state", None))
    state = response.json()
    assert state["simulated_time"] == "2025-01-13T05:00:00Z"
    assert [*state["rooms"]] == ["room1", "room2", "room3"]
    assert state["rooms"]["room2"]["T_air"] == pytest.approx(plant.world.now.air[1])
    assert state["rooms"]["room2"]["parameters"] == plant.building.rooms[1].theta


def test_a_fault_is_switched_on_shown_and_switched_off() -> None:
    plant = simulation(Clock())
    body = {"kind": "drift", "device": "room1", "channel": "T_air", "value": 0.5, "for": "5min"}
    switched, listed = ask(plant, ("POST", "/faults", body), ("GET", "/faults", None))
    assert switched.status_code == 201
    assert listed.json() == [switched.json()]
    assert switched.json() == {
        "id": 1,
        "kind": "drift",
        "device": "room1",
        "channel": "T_air",
        "value": 0.5,
        "active": True,
        "begins_in": 0,
        "ends_in": 300,
    }
    assert plant.faults.active("drift", "room1", "T_air")
    gone, again = ask(plant, ("DELETE", "/faults/1", None), ("DELETE", "/faults/1", None))
    assert (gone.status_code, again.status_code) == (204, 404)
    assert again.json()["detail"] == "there is no fault 1; GET /faults lists them"
    assert plant.faults.active("drift", "room1", "T_air") is None


def test_a_fault_for_later_says_when() -> None:
    clock, plant = started()
    ask(plant, ("POST", "/faults", {"kind": "freeze", "after": "1min"}))
    clock.now += 20
    (waiting,) = ask(plant, ("GET", "/faults", None))
    assert (waiting.json()[0]["active"], waiting.json()[0]["begins_in"], waiting.json()[0]["ends_in"]) == (
        False,
        40,
        None,
    )
    (cleared,) = ask(plant, ("DELETE", "/faults", None))
    assert cleared.status_code == 204
    assert plant.faults.listed() == []


@tabled
def test_mistakes_are_explained(body: dict[str, Any], gist: str) -> None:
    (response,) = ask(simulation(Clock()), ("POST", "/faults", body))
    assert response.status_code == 422
    assert gist in response.json()["detail"]


def test_the_plants_side_sets_heating_and_set_points() -> None:
    clock, plant = started()
    relay, half, valve, unknown, odd, empty = ask(
        plant,
        ("PUT", "/rooms/room1", {"u_heat": 1500}),
        ("PUT", "/rooms/room1", {"u_heat": 700}),
        ("PUT", "/rooms/room2", {"u_heat": 700, "set_point": 23}),
        ("PUT", "/rooms/attic", {"u_heat": 0}),
        ("PUT", "/rooms/room2", {"power": 5}),
        ("PUT", "/rooms/room3", {"set_point": 99}),
    )
    assert (relay.status_code, valve.status_code) == (200, 200)
    assert half.json()["detail"] == "u_heat: the heater of room1 cannot give 700 W; a relay gives 0 or 1500 W"
    assert unknown.json()["detail"] == 'there is no room "attic"; the rooms are room1, room2, room3'
    assert (odd.status_code, empty.status_code) == (422, 422)
    clock.now += 60
    plant.catch_up()
    assert plant.world.now.power[:2].tolist() == [1500.0, 700.0]
    assert plant.world.now.set_point[1] == 23.0
    ask(plant, ("DELETE", "/rooms/room2", None))
    clock.now += 1
    plant.catch_up()
    assert plant.world.now.set_point[1] < 22.0
