"""What a user waits for and pays: replay, start, answers, memory, and a fleet, on the commands as they are run.

One recording feeds every zone of a site: a row of all columns for each period. Paced, a row closes the interval before
it for all zones at once, at instants that follow each other without drift.
"""

import gc
import json
import os
import subprocess
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from bench.rows import Row, Sizes, text
from support import sites
from support.harness import THERMOGATE, Daemon
from support.observed import Answer, clients, latency, loop_delays, resident_bytes, scrape
from support.zenoh_plant import endpoint, session

from adapters.fields.durations import format_duration
from estimator.network.presets import network
from replay.recorded.tables import cells, utc_stamps, write_table
from replay.simulated import semi_synthetic
from replay.simulated.semi_synthetic import PERIOD
from service.config import load as configuration
from service.config.fitting import make_alignment, make_worker
from service.recordings.samples import read_samples

BUILDING = "building-67"
PATIENCE = 300.0
_ZONE = "zone-0000"


class Campus(NamedTuple):
    """What is fed: `zones` of `preset` with `particles` each by `rows` rows, an instant every `every` s; None: as fast
    as it goes."""

    zones: int
    particles: int
    rows: int
    every: float | None = None
    preset: str = BUILDING


def names(count: int) -> list[str]:
    """The ids of the zones."""
    return [f"zone-{index:04d}" for index in range(count)]


def written(campus: Campus, folder: Path, **tables: Any) -> Path:
    """Recording and configuration in `folder`, which is made; the path of the configuration, with more `tables`."""
    folder.mkdir(parents=True, exist_ok=True)
    house, rows = network(campus.preset), campus.rows
    recording = semi_synthetic.generate(None, seed=1)
    columns, zones = {"time": utc_stamps(recording.times[:rows])}, []
    for index, zone in enumerate(names(campus.zones)):
        # Every zone lives in another stretch of the same months.
        begin = index * 20 % (len(recording.times) - rows + 1)
        channels = {}
        for channel in house.channels:
            column = f"{zone} {channel}"
            columns[column] = cells(recording.columns[channel][begin : begin + rows], 4)
            channels[channel] = {"source": "log", "column": column, "unit": house.channel_unit(channel)}
        own = {"id": zone, "period": format_duration(PERIOD), "network": campus.preset, "estimator": "rbpf"}
        zones.append(own | {"estimator_options": {"particles": campus.particles}, "channels": channels})
    log = {"kind": "csv", "files": [write_table(folder / "log.csv", columns).name], "timestamp": {"column": "time"}}
    pace: object = "max" if campus.every is None else PERIOD / campus.every
    return sites.written(folder, {"log": log | {"pace": pace}}, zones, **tables)


def months(sizes: Sizes) -> list[Row]:
    """Five months of samples through `thermogate replay`, CSV in and results out."""
    with TemporaryDirectory(prefix="thermogate-bench-") as name:
        folder, campus = Path(name), Campus(1, sizes.particles, sizes.replay_samples + 4)
        config, began = written(campus, folder), time.perf_counter()
        with (folder / "log").open("w") as log:
            command = [THERMOGATE, "replay", str(config), "--out", str(folder / "results")]
            process = subprocess.Popen(command, stdout=log, stderr=log)
            # `wait4` has the peak memory of this one child; `getrusage` only that of the largest so far.
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - began
        assert process.returncode == 0, (folder / "log").read_text(encoding="utf-8")
    found = f"{text(wall)} for {campus.rows:,} samples, peak {usage.ru_maxrss * 1024 / 1e6:.0f} MB"
    return [Row("five months at 600 s, `thermogate replay`", "under 60 s", found, wall < 60.0)]


def memory(sizes: Sizes) -> list[Row]:
    """Resident memory against the number of zones, each with a real worker: a fixed base and so much a zone."""
    with TemporaryDirectory(prefix="thermogate-bench-") as name:
        config = configuration.load(written(Campus(1, sizes.particles, 7), Path(name)))
        (table,) = config.zones
        samples = read_samples(config, [table])[table.id].samples
    zones: list[Any] = []
    resident = []
    for count in sizes.resident_zones:
        while len(zones) < count:
            own = table.model_copy(update={"id": f"zone-{len(zones)}", "seed": len(zones)})
            worker = make_worker(own)
            for sample in samples[:3]:
                worker.step(sample)
            zones.append((worker, make_alignment(own)))
        gc.collect()
        resident.append(resident_bytes(os.getpid()))
    each, base = np.polyfit(sizes.resident_zones, resident, 1)
    found = f"{each / 1e6:.2f} MB beyond {base / 1e6:.0f} MB"
    return [Row("memory of a zone beyond a fixed base", "at most 2.6 MB", found, bool(each <= 2.6e6))]


def start(sizes: Sizes) -> list[Row]:
    """From the command to a serving daemon and its first forecast: cold, warm, and for other networks and counts."""
    settings = ((BUILDING, 1), (BUILDING, 1), ("titeth", 2), ("titeth", 3))
    with TemporaryDirectory(prefix="thermogate-bench-") as name:
        cache = Path(name) / "kernels"
        cache.mkdir()
        os.environ["NUMBA_CACHE_DIR"] = str(cache)
        cold, warm, other, count = (
            _started(Campus(1, sizes.particles // part, 148, preset=preset), Path(name) / str(turn), cache)
            for turn, (preset, part) in enumerate(settings)
        )
    rows = [
        Row(
            f"start to serving a forecast, {how}",
            f"under {limit:g} s",
            f"{text(forecast)}; REST answers after {text(serving)}",
            forecast < limit,
        )
        for how, limit, (serving, forecast, _) in (("warm kernel cache", 2.0, warm), ("cold", 20.0, cold))
    ]
    found = f"{other[2]} kernels for another network, {count[2]} for another count"
    once = "one compilation serves every network and count"
    return [*rows, Row(once, "nothing compiled anew", found, other[2] + count[2] == 0)]


def _started(campus: Campus, folder: Path, cache: Path) -> tuple[float, float, int]:
    """s to serving and to a forecast, and how many kernels were compiled."""

    def kernels() -> int:
        return sum(1 for _ in cache.rglob("*.nbc"))

    config, compiled = written(campus, folder), kernels()
    began = time.monotonic()
    with Daemon(config, folder / "daemon.log") as daemon:
        # Harness and client wait in steps of 50 ms, which is too long here.
        while "serving on" not in daemon.log():
            assert daemon.process.poll() is None, daemon.log()
            time.sleep(0.005)
        daemon.get("/healthz")
        serving = time.monotonic() - began
        while daemon.get(f"/zones/{_ZONE}/forecast")[0] != 200:
            assert time.monotonic() < began + PATIENCE, daemon.log()
            time.sleep(0.01)
        forecast = time.monotonic() - began
        assert daemon.terminate() == 0
    return serving, forecast, kernels() - compiled


class Instant(NamedTuple):
    """When the first and the last forecast of an instant came (monotonic s), and how many did not."""

    began: float
    ended: float
    missing: int


def fleet(sizes: Sizes) -> list[Row]:
    """Zones in the real daemon whose samples land at the same instant, again and again.

    A subscriber on Zenoh hears every forecast. An instant counts from its first forecast, which comes some ms after it;
    the one before those that are measured starts the filters.
    """
    zones, particles, every, count = sizes.fleet
    # Some rows more, so that no zone comes to its end while it is measured.
    campus, heard = Campus(zones, particles, count + 4, every), list[tuple[float, bytes]]()
    place = endpoint()
    with TemporaryDirectory(prefix="thermogate-fleet-") as name, session(listen=place) as listening:
        # The clock of the recording starts when the listener hears every zone.
        zenoh = {"listen": [], "connect": [place], "await_subscriber": "2min"}
        config = written(campus, Path(name), zenoh=zenoh)
        command = [THERMOGATE, "replay", str(config), "--zone", _ZONE, "--out", str(Path(name) / "compiled")]
        subprocess.run(command, check=True, capture_output=True)
        # Read later: what takes time here would be taken from the daemon that is measured.
        subscriber = listening.declare_subscriber(
            "thermogate/*/*/forecast", lambda sample: heard.append((time.monotonic(), sample.payload.to_bytes()))
        )
        with Daemon(config, Path(name) / "daemon.log", {"zenoh.enabled": True}) as daemon:
            memory = _awaited(daemon, heard, zones)
            before = scrape(daemon)
            with clients(daemon.url(), names(zones), 4, 0.05) as finish:
                memory = max(memory, _awaited(daemon, heard, zones * (1 + count)))
                answers = finish()
            loop = loop_delays(before, scrape(daemon))
            assert daemon.terminate() == 0, daemon.log()
        subscriber.undeclare()
    found = instants(arrivals(heard), zones, count)
    rest, last = latency(during(answers, found)), max(one.ended - one.began for one in found)
    complete = len(found) == count and not any(one.missing for one in found)
    return [
        Row(
            "resident memory of the daemon with all zones",
            "under 3 GB",
            f"{memory / 1e9:.2f} GB with {zones:,} zones",
            memory < 3e9,
        ),
        Row(
            "all samples at the same instant: last forecast",
            "within 3 s",
            f"{text(last)}, the slowest of {count} instants" + ("" if complete else "; FORECASTS ARE MISSING"),
            last <= 3.0 and complete,
        ),
        Row(
            "REST meanwhile, 99th percentile",
            "under 25 ms",
            f"{text(rest['p99_s'])} of {rest['requests']:,} requests",
            rest["p99_s"] is not None and rest["p99_s"] < 0.025 and not rest["not_ok"],
        ),
        Row(
            "event loop held",
            "never longer than 20 ms",
            f"{loop['late']:.0f} of {loop['timers']:,.0f} timers later; none later than "
            f"{text(loop['none_later_than_s'])}",
            loop["late"] == 0,
        ),
    ]


def _awaited(daemon: Daemon, heard: Sequence[object], forecasts: int) -> int:
    """Wait for so many forecasts, or until none has come for long; the largest resident memory meanwhile, bytes."""
    memory, seen, since = 0, -1, time.monotonic()
    while (count := len(heard)) < forecasts:
        assert daemon.process.poll() is None, daemon.log()
        memory = max(memory, resident_bytes(daemon.process.pid))
        if count != seen:
            seen, since = count, time.monotonic()
        assert time.monotonic() < since + PATIENCE, f"{count} of {forecasts} forecasts came, and then none"
        time.sleep(0.2)
    return memory


def arrivals(heard: Sequence[tuple[float, bytes]]) -> dict[float, dict[str, float]]:
    """Per sample time (UTC s): when the forecast of each zone arrived first."""
    found: dict[float, dict[str, float]] = defaultdict(dict)
    for arrived, payload in tuple(heard):
        forecast = json.loads(payload)
        found[datetime.fromisoformat(forecast["sample_time"]).timestamp()].setdefault(forecast["zone"], arrived)
    return dict(found)


def instants(arrived: Mapping[float, Mapping[str, float]], zones: int, count: int) -> list[Instant]:
    """Those that are measured, as far as anything came of them."""
    return [
        Instant(min(times.values()), max(times.values()), zones - len(times))
        for _, times in sorted(arrived.items())[1 : 1 + count]
    ]


def during(answers: Sequence[Answer], bursts: Sequence[Instant]) -> list[Answer]:
    """Those that were waited for while zones were being stepped."""
    return [
        answer for answer in answers if any(one.began <= answer.answered and answer.sent <= one.ended for one in bursts)
    ]
