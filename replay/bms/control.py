"""The control surface of the simulated plant over HTTP on loopback: the truth, set-points and heating, and faults."""

import math
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Response
from fastapi.responses import RedirectResponse
from pydantic import BaseModel, ConfigDict, Field

from adapters.fields.times import utc
from replay.bms.faults import Fault, FaultError, FaultSpec
from replay.bms.simulation import Simulation
from service.config.http import HttpConfig
from service.web import problems as api_problems
from service.web.guard import Guard
from service.web.page import files
from service.web.problems import documented, invalid
from service.web.server.refusal import RequestRefused


class Order(BaseModel):
    """What somebody at the plant wants of a room, until it is withdrawn; null leaves it to schedule and thermostat."""

    model_config = ConfigDict(extra="forbid")

    set_point: float | None = Field(None, ge=5.0, le=35.0, description="degC")
    u_heat: float | None = Field(None, description="W; overrules the thermostat")


def create_control(simulation: Simulation) -> FastAPI:
    app = FastAPI(title="Thermogate simulated BMS", description=__doc__ or "", docs_url=None, redoc_url=None)
    api_problems.install(app)
    app.add_middleware(Guard, config=HttpConfig())
    files.install_documentation(app)
    board = simulation.faults

    @app.get("/", include_in_schema=False)
    async def root() -> RedirectResponse:
        return RedirectResponse("/docs")

    @app.get("/state", summary="The truth, without sensors and faults")
    async def state() -> dict[str, Any]:
        return _state(simulation)

    @app.get("/faults", summary="Faults that act or will")
    async def faults() -> list[dict[str, Any]]:
        return [_shown(fault, begins_in) for fault, begins_in in board.listed()]

    @app.post("/faults", status_code=HTTPStatus.CREATED, responses=documented(422), summary="Switch a fault on")
    async def switch_on(spec: FaultSpec) -> dict[str, Any]:
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


def _shown(fault: Fault, begins_in: float) -> dict[str, Any]:
    """A fault that acts or will; durations in real s, null for ever."""
    ends_in = None if math.isinf(fault.ends) else round(begins_in + fault.ends - fault.begins, 3)
    return {
        "id": fault.id,
        **{name: getattr(fault.spec, name) for name in ("kind", "device", "channel")},
        "value": fault.value,
        "active": begins_in <= 0,
        "begins_in": max(round(begins_in, 3), 0.0),
        "ends_in": ends_in,
    }


def _state(simulation: Simulation) -> dict[str, Any]:
    """Temperatures and set-points in degC, flows of heat in W (`unmeasured` is people, sun and open windows together),
    openings in W/K; parameters are capacitances in J/K of simulated time and conductances in W/K."""
    now = simulation.world.now
    columns = {
        "T_air": now.air,
        "T_env": now.envelope,
        "T_heater": now.heater,
        "set_point": now.set_point,
        "u_heat": now.power,
        "unmeasured": now.gain,
        "opening": now.opening,
    }
    return {
        "simulated_time": utc(now.time),
        "pace": simulation.pace,
        "T_out": now.outdoor,
        "I_sol": now.irradiance,
        "rooms": {
            room.name: {name: float(values[k]) for name, values in columns.items()} | {"parameters": room.theta}
            for k, room in enumerate(simulation.building.rooms)
        },
    }
