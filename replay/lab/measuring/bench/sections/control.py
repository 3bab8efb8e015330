"""What a controller waits for: the fans of all zones in one request, and a model, over HTTP."""

from __future__ import annotations

import asyncio
import json
import os
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from estimator import registry
from estimator.network.presets import network
from replay.lab.measuring.bench.sizes import Sizes
from replay.lab.measuring.bench.workload import spread, timed
from service.config.http import HttpConfig
from service.publish.metrics import Metrics
from service.records.sample import Sample
from service.store.store import Store
from service.web.app import create_app
from service.web.server.server import HttpServer
from service.zone.plumbing import Plumbing
from service.zone.questions import Questions
from service.zone.worker import WorkerSettings, ZoneWorker
from service.zone.zone import Zone

_PERIOD = 300
_LEARNED = 36
"""Samples that a zone has learned from: its parameters are still wide, which makes the quantiles the most work."""
_REPEATS = 5


def control(sizes: Sizes) -> Mapping[str, Any]:
    """Wall times of `POST /forecasts` over a day for every estimator, and of a model."""
    with TemporaryDirectory(prefix="thermogate-control-") as folder:
        return {
            "zones": sizes.control_zones,
            "particles": sizes.particles,
            "estimators": {
                name: _measured(Path(folder) / name, name, options, sizes.control_zones)
                for name, options in (("bank", {}), ("rbpf", {"particles": sizes.particles}), ("mkf", {}), ("ekf", {}))
            },
        }


def _measured(folder: Path, estimator: str, options: Mapping[str, object], count: int) -> Mapping[str, Any]:
    with _served(folder, estimator, options, count) as url:
        plan = {"inputs": {"*": {"u_heat": {"step": "1h", "values": [1000.0, 0.0] * 12}}}}
        request: dict[str, Any] = {"horizon": "24h", "levels": [0.95], "plans": [plan]}
        answer = json.loads(_post(f"{url}/forecasts", request))
        steps = len(answer["plans"][0]["zones"][-1]["outputs"][0]["mean"])
        # The server is in this process: its processor time tells what a busy machine adds to the wall time.
        begun = time.process_time()
        fans = [timed(lambda: _post(f"{url}/forecasts", request))[0] for _ in range(_REPEATS)]
        processor = (time.process_time() - begun) / _REPEATS
        models = [timed(lambda: _get(f"{url}/zones/zone-0/model?step=15min"))[0] for _ in range(_REPEATS)]
        return {"steps": steps, "fans": spread(fans), "processor_s": processor, "model": spread(models)}


@contextmanager
def _served(folder: Path, estimator: str, options: Mapping[str, object], count: int) -> Iterator[str]:
    """The URL of a server of `count` zones that have learned a little."""
    ready, url, stop = threading.Event(), list[str](), list[Callable[[], object]]()

    async def serve() -> None:
        metrics = Metrics({})
        store, threads = Store(folder), os.cpu_count() or 1
        with ThreadPoolExecutor(threads) as pool, ThreadPoolExecutor(threads) as asking:
            stopping = threading.Event()
            plumbing = Plumbing("bench", store, pool, Questions(asking, stopping), stopping, metrics, (metrics,), 1e9)
            worker = _learned(estimator, options)
            zones = {}
            for place in range(count):
                own = Zone(f"zone-{place}", estimator, "bench", worker, plumbing)
                zones[own.id] = own
            app, http = create_app("bench", zones, metrics.registry), HttpConfig(port=0)
            server, loop, ended = HttpServer(app, http), asyncio.get_running_loop(), asyncio.Event()
            serving = asyncio.create_task(server.run())
            await server.started(serving)
            url.append(server.url)
            stop.append(lambda: loop.call_soon_threadsafe(ended.set))
            ready.set()
            await ended.wait()
            await server.stop(serving)
        store.close()

    thread = threading.Thread(target=lambda: asyncio.run(serve()), name="served")
    thread.start()
    ready.wait()
    try:
        yield url[0]
    finally:
        stop[0]()
        thread.join()


def _learned(estimator: str, options: Mapping[str, object]) -> ZoneWorker:
    """A worker after some hours of heating and cooling. All zones share it: its state is never changed in place."""
    net = network("titeth")
    worker = ZoneWorker(registry.build(estimator, net, _PERIOD, options), WorkerSettings(1, (0.95,), 12, 900.0))
    rng = np.random.default_rng(1)
    for k in range(_LEARNED):
        outputs = np.array([20.0 + np.sin(k / 8) + 0.05 * rng.standard_normal()])
        inputs = np.array([5.0, 1500.0 * (k % 12 < 6)])
        worker.step(Sample.measured(k * _PERIOD, outputs, inputs))
    return worker


def _post(url: str, body: Mapping[str, Any]) -> bytes:
    headers = {"Content-Type": "application/json"}
    return _answer(urllib.request.Request(url, json.dumps(body).encode(), headers))


def _get(url: str) -> bytes:
    return _answer(urllib.request.Request(url))


def _answer(request: urllib.request.Request) -> bytes:
    with urllib.request.urlopen(request, timeout=600) as answer:
        found: bytes = answer.read()
        return found
