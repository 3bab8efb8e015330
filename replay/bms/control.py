"""The control surface of the simulated plant over HTTP on loopback: the truth, set-points and heating, and faults."""

from __future__ import annotations

import math
from datetime import datetime
from http import HTTPStatus

from fastapi import FastAPI, Response
from fastapi.responses import PlainTextResponse, RedirectResponse
from pydantic import BaseModel, ConfigDict, Field

from adapters.fields.times import utc
from replay.bms.faults import MENU, Fault, FaultError, FaultSpec
from replay.bms.register_map import as_csv
from replay.bms.simulation import Simulation
from service.config.http import HttpConfig
from service.web import pages as api_pages
from service.web import problems as api_problems
from service.web.guard import Guard
from service.web.problems import documented, invalid
from service.web.server.refusal import RequestRefused


class RoomState(BaseModel):
    """The truth about a room: temperatures and set-point in degC, flows of heat in W, openings in W/K."""

    T_air: float
    T_env: float
    T_heater: float
    set_point: float
    u_heat: float
    unmeasured: float = Field(description="people, sun and open windows together")
    opening: float = Field(description="windows, those left open by a fault included")
    parameters: dict[str, float] = Field(description="true capacitances in J/K of simulated time, conductances in W/K")


class State(BaseModel):
    """The truth, without sensors and faults."""

    simulated_time: datetime
    pace: float
    T_out: float
    I_sol: float = Field(description="global irradiance, W/m2")
    rooms: dict[str, RoomState]


class Order(BaseModel):
    """What somebody at the plant wants of a room, until it is withdrawn; null leaves it to schedule and thermostat."""

    model_config = ConfigDict(extra="forbid")

    set_point: float | None = Field(None, ge=5.0, le=35.0, description="degC")
    u_heat: float | None = Field(None, description="W; overrules the thermostat")


class FaultState(BaseModel):
    """A fault that acts or will; durations in real s, null for ever."""

    id: int
    kind: str
    device: str | None
    channel: str | None
    value: float
    active: bool
    begins_in: float = Field(description="0 when it acts")
    ends_in: float | None


class MenuEntry(BaseModel):
    """A kind of fault, and what its value means."""

    kind: str
    acts_on: str
    value: str | None
    default: float | None
    meaning: str


def create_control(simulation: Simulation) -> FastAPI:
    """The ASGI application."""
    app = FastAPI(title="Thermogate simulated BMS", description=__doc__ or "", docs_url=None, redoc_url=None)
    api_problems.install(app)
    app.add_middleware(Guard, config=HttpConfig())
    api_pages.install_documentation(app)
    board = simulation.faults

    @app.get("/", include_in_schema=False)
    async def root() -> RedirectResponse:
        return RedirectResponse("/docs")

    @app.get("/state", summary="The truth, without sensors and faults")
    async def state() -> State:
        return _state(simulation)

    @app.get("/registers", response_class=PlainTextResponse, summary="The register map as CSV")
    async def registers() -> str:
        return as_csv(simulation.plant)

    @app.get("/menu", summary="What can go wrong")
    async def menu() -> list[MenuEntry]:
        return [
            MenuEntry(
                kind=name,
                acts_on=kind.scope,
                value=kind.value_unit or None,
                default=kind.default,
                meaning=kind.meaning,
            )
            for name, kind in MENU.items()
        ]

    @app.get("/faults", summary="Faults that act or will")
    async def faults() -> list[FaultState]:
        return [_shown(fault, begins_in) for fault, begins_in in board.listed()]

    @app.post("/faults", status_code=HTTPStatus.CREATED, responses=documented(422), summary="Switch a fault on")
    async def switch_on(spec: FaultSpec) -> FaultState:
        try:
            fault = board.add(spec)
        except FaultError as error:
            raise invalid([str(error)]) from None
        return _shown(fault, spec.after)

    @app.delete("/faults", status_code=HTTPStatus.NO_CONTENT, summary="Switch every fault off")
    async def switch_all_off() -> Response:
        board.clear()
        return Response(status_code=HTTPStatus.NO_CONTENT)

    @app.delete(
        "/faults/{number}",
        status_code=HTTPStatus.NO_CONTENT,
        responses=documented(404),
        summary="Switch a fault off",
    )
    async def switch_off(number: int) -> Response:
        if not board.remove(number):
            raise RequestRefused(HTTPStatus.NOT_FOUND, [f"there is no fault {number}; GET /faults lists them"])
        return Response(status_code=HTTPStatus.NO_CONTENT)

    @app.get("/rooms/{room}", responses=documented(404), summary="What is wanted of a room")
    async def wanted(room: str) -> Order:
        return _order(simulation, _index(simulation, room))

    @app.put("/rooms/{room}", responses=documented(404, 422), summary="Set a room's set-point or heating")
    async def command(room: str, order: Order) -> Order:
        index = _index(simulation, room)
        if order.u_heat is not None:
            limit = simulation.building.rooms[index].thermostat.can_give(order.u_heat)
            if limit is not None:
                raise invalid([f"u_heat: the heater of {room} cannot give {order.u_heat:g} W; {limit}"])
        for values, value in zip(simulation.orders, (order.set_point, order.u_heat), strict=True):
            values[index] = math.nan if value is None else value
        return order

    @app.delete(
        "/rooms/{room}",
        status_code=HTTPStatus.NO_CONTENT,
        responses=documented(404),
        summary="Leave a room to its schedule and thermostat",
    )
    async def leave(room: str) -> Response:
        index = _index(simulation, room)
        for values in simulation.orders:
            values[index] = math.nan
        return Response(status_code=HTTPStatus.NO_CONTENT)

    return app


def _index(simulation: Simulation, room: str) -> int:
    names = [known.name for known in simulation.building.rooms]
    if room not in names:
        raise RequestRefused(HTTPStatus.NOT_FOUND, [f'there is no room "{room}"; the rooms are {", ".join(names)}'])
    return names.index(room)


def _order(simulation: Simulation, index: int) -> Order:
    return Order(set_point=_known(simulation.orders.set_point[index]), u_heat=_known(simulation.orders.power[index]))


def _known(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def _shown(fault: Fault, begins_in: float) -> FaultState:
    ends_in = None if math.isinf(fault.ends) else round(begins_in + fault.ends - fault.begins, 3)
    return FaultState(
        id=fault.id,
        kind=fault.spec.kind,
        device=fault.spec.device,
        channel=fault.spec.channel,
        value=fault.value,
        active=begins_in <= 0,
        begins_in=max(round(begins_in, 3), 0.0),
        ends_in=ends_in,
    )


def _state(simulation: Simulation) -> State:
    now = simulation.world.now
    return State(
        simulated_time=utc(now.time),
        pace=simulation.pace,
        T_out=now.outdoor,
        I_sol=now.irradiance,
        rooms={
            room.name: RoomState(
                T_air=now.air[k],
                T_env=now.envelope[k],
                T_heater=now.heater[k],
                set_point=now.set_point[k],
                u_heat=now.power[k],
                unmeasured=now.gain[k],
                opening=now.opening[k],
                parameters=room.theta,
            )
            for k, room in enumerate(simulation.building.rooms)
        },
    )
