"""Daemons that read simulated Modbus devices."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import tomli_w
from support.modbus_plant import Plant, serving

WORDS = [215, 53, 400, 21]
"""Tenths of the room and of the outdoor temperature, W, and another room."""


@contextmanager
def running(site: Plant, port: int = 0) -> Iterator[Plant]:
    """`site` served by a thread of its own."""
    loop = asyncio.new_event_loop()
    ready, stop = threading.Event(), asyncio.Event()

    async def serve() -> None:
        async with serving(site, port=port):
            ready.set()
            await stop.wait()

    def work() -> None:
        with asyncio.Runner(loop_factory=lambda: loop) as runner:
            runner.run(serve())

    thread = threading.Thread(target=work)
    thread.start()
    try:
        assert ready.wait(180)
        yield site
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join()


def configuration(folder: Path, ports: dict[str, int]) -> Path:
    """One zone per source, one-second samples, few particles."""
    tenths = {"type": "int16", "scale": 0.1, "unit": "degC"}
    tables = {
        "site": {"id": "plant", "state_dir": str(folder / "state")},
        "sources": {
            name: {
                "kind": "modbus",
                "host": "127.0.0.1",
                "port": port,
                "poll": 0.2,
                "timeout": 30.0,
                "retries": 0,
                "first_register": 0,
                "fill_gaps": 0,
            }
            for name, port in ports.items()
        },
        "zones": [
            {
                "id": f"zone-{name}",
                "period": "1s",
                "network": "tite",
                "hold_inputs": "20s",
                "max_gap": 40,
                "estimator_options": {"particles": 50},
                "channels": {
                    "T_i": {"source": name, "register": 0, **tenths},
                    "T_out": {"source": name, "register": 1, **tenths},
                    "u_heat": {"source": name, "register": 2, "type": "uint16", "unit": "W"},
                },
            }
            for name in ports
        ],
    }
    path = folder / "plant.toml"
    path.write_text(tomli_w.dumps(tables), encoding="utf-8")
    return path
