"""`thermogate simulate-bms`: everything started, served until asked to stop, and stopped."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Coroutine, Sequence
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adapters.cancelling import in_thread
from replay.bms import register_map
from replay.bms.bacnet import objects as bacnet_objects
from replay.bms.control import create_control
from replay.bms.faults import FaultSpec
from replay.bms.modbus_server import ModbusServer
from replay.bms.simulation import Simulation
from replay.bms.written_config import write_config
from replay.bms.zenoh_publisher import ZenohPublisher
from replay.errors import ReplayError
from service.config.site import HttpConfig
from service.daemon.logs import configure_logging
from service.daemon.tasks import end
from service.web.server.server import HttpServer

if TYPE_CHECKING:
    from replay.bms.bacnet.server import BacnetServer

_CLOSE_SECONDS = 1.0
"""After this time the Zenoh session is left to the end of the process."""


@dataclass(frozen=True)
class BmsOptions:
    """What the command line says: ports of 0 are any free ones, None of `zenoh` and `bacnet` are off."""

    zones: int = 4
    port: int = 5020
    control_port: int = 5021
    zenoh: str | None = "tcp/127.0.0.1:7448"
    bacnet: int | None = None
    pace: float = 60.0
    seed: int = 1
    faults: Sequence[FaultSpec] = ()
    config: Path | None = None
    overrides: Sequence[str] = ()


def simulate_bms(options: BmsOptions) -> int:
    """Serve until SIGTERM or SIGINT; 0 after an orderly stop. ReplayError or ServiceError where the start fails."""
    configure_logging()

    async def main() -> None:
        stop = asyncio.Event()
        for signum in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(signum, stop.set)
        await serve(options, stop, lambda lines: print("\n".join(lines), flush=True))

    asyncio.run(main())
    return 0


async def serve(options: BmsOptions, stop: asyncio.Event, ready: Callable[[list[str]], None]) -> None:
    """Serve until `stop`; `ready` is called with what there is to say once everything answers."""
    simulation = Simulation(zones=options.zones, seed=options.seed, pace=options.pace)
    for fault in options.faults:
        simulation.faults.add(fault)
    http = HttpServer(create_control(simulation), HttpConfig(port=options.control_port), "--control-port")
    bacnet: BacnetServer | None = None
    async with AsyncExitStack() as opened:
        opened.callback(http.close)
        modbus = await ModbusServer.start(simulation, options.port)
        opened.push_async_callback(modbus.stop)
        works: list[Callable[[], Coroutine[Any, Any, None]]] = [http.run, simulation.run]
        if options.bacnet is not None:
            bacnet = await _bacnet(simulation, options.bacnet)
            opened.push_async_callback(bacnet.stop)
            works.append(bacnet.run)
        if options.zenoh is not None:
            publisher = await asyncio.to_thread(ZenohPublisher.open, options.zenoh, simulation)
            opened.push_async_callback(_closed, publisher)
            works.append(publisher.run)
        if options.config is not None:
            write_config(options.config, simulation, modbus.port, options.overrides)
        tasks = [asyncio.create_task(work()) for work in works]
        opened.push_async_callback(end, tasks)
        await http.started(tasks[0])
        ready(_greeting(options, simulation, modbus.port, bacnet.port if bacnet else None, http.url))
        await _until(stop, tasks)
        await http.stop(tasks[0])


async def _closed(publisher: ZenohPublisher) -> None:
    with suppress(TimeoutError):
        async with asyncio.timeout(_CLOSE_SECONDS):
            await in_thread(publisher.close)


async def _bacnet(simulation: Simulation, port: int) -> BacnetServer:
    if find_spec("bacpypes3") is None:
        raise ReplayError("--bacnet needs bacpypes3; install it with: pip install 'thermogate[bacnet]'")
    from replay.bms.bacnet.server import BacnetServer

    return await BacnetServer.start(simulation, port)


async def _until(stop: asyncio.Event, tasks: Sequence[asyncio.Task[None]]) -> None:
    """Wait for `stop`; the failure of a task is raised."""
    stopping = asyncio.create_task(stop.wait())
    done, _ = await asyncio.wait([stopping, *tasks], return_when=asyncio.FIRST_COMPLETED)
    stopping.cancel()
    for task in done:
        task.result()


def _greeting(options: BmsOptions, simulation: Simulation, port: int, bacnet: int | None, url: str) -> list[str]:
    lines = [
        *register_map.as_text(simulation.plant),
        "",
        f"SYNTHETIC building, {options.zones} rooms, {options.pace:g} simulated s per s, seed {options.seed}",
        f"Modbus TCP  127.0.0.1:{port}; registers count from 0",
        f"Zenoh       {options.zenoh or 'off'}" + ("; keys bms/{plain,json,senml}/**" if options.zenoh else ""),
        f"BACnet/IP   {bacnet_objects.served(simulation.plant, bacnet)}",
        f"Control     {url}; GET /state, /faults; POST /faults; DELETE /faults/<id>",
        f"            {url}; PUT and DELETE /rooms/<room>: set-point and heating",
    ]
    if options.config is not None:
        lines.append(f"Configuration: thermogate run {options.config}")
    return [*lines, "Ctrl-C stops."]
