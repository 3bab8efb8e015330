"""Attacks by those who bring readings: on MQTT and on Zenoh, and over HTTP with a key of their own.

Each runs beside an honest publisher of the same source, whose zone may lose no interval. AssertionError where something
gave way.
"""

from __future__ import annotations

import gzip
import json
import multiprocessing
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import tomli_w
from attack.victim import Target
from support.broker import Party, broker
from support.harness import Daemon, free_port
from support.zenoh_parties import opened

from service.web.keys import create_key

LONGEST = 65_536
MESSAGES = 1500
SECONDS = 15.0
WILD = 5
"""Zones that read the flooded key."""

HONEST = {"T_i": ("room", "degC", "20.5"), "T_out": ("outside", "degC", "4"), "u_heat": ("heating", "W", "1500")}

Put = Callable[[str, bytes], None]


def long_base_name() -> bytes:
    """SenML with a base name that is most of the message, and as many records as fit beside it."""
    records = ",".join(['{"n":"T0","v":20}'] * 900)
    return f'[{{"bn":"{"x" * (LONGEST - len(records) - 20)}"}},{records}]'.encode()


def many_records() -> bytes:
    """SenML with as many records of one channel as fit."""
    return b"[" + b",".join([b'{"n":"T0","v":20}'] * (LONGEST // 18 - 1)) + b"]"


def dense_lists() -> bytes:
    """JSON that is all brackets."""
    return b"[" + b"[]," * (LONGEST // 3 - 2) + b"[]]"


FLOODS = (long_base_name, many_records, dense_lists)


def _mqtt_flood(place: str) -> None:
    with Party(int(place)) as party:
        for flood in FLOODS:
            for _ in range(MESSAGES // len(FLOODS)):
                party.put("plant/wild", flood())
        # It is at the broker behind all the others.
        party.put("plant/wild", b"[]", qos=1)


def _zenoh_flood(place: str) -> None:
    with opened({"mode": "client", "connect/endpoints": [place]}) as session:
        for flood in FLOODS:
            for _ in range(MESSAGES // len(FLOODS)):
                session.put("plant/wild", flood())
        # What was put is sent by other threads.
        time.sleep(1.0)


@contextmanager
def _telling(put: Put) -> Iterator[None]:
    """Publish the honest values five times a second."""
    ended = threading.Event()

    def tell() -> None:
        while not ended.wait(0.2):
            for topic, _, value in HONEST.values():
                put(f"plant/{topic}", value.encode())

    thread = threading.Thread(target=tell)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _zone(id: str, channels: dict[str, Any]) -> dict[str, Any]:
    return {
        "id": id,
        "period": "1s",
        "network": "tite",
        "hold_inputs": "20s",
        "estimator_options": {"particles": 50},
        "channels": channels,
    }


def _written(folder: Path, source: dict[str, Any], zones: Sequence[dict[str, Any]]) -> Path:
    tables = {
        "site": {"id": "plant", "state_dir": str(folder / "state")},
        "sources": {"bus": source},
        "zones": list(zones),
    }
    path = folder / "plant.toml"
    path.write_text(tomli_w.dumps(tables), encoding="utf-8")
    return path


def _on_bus(folder: Path, source: dict[str, Any], locator: str) -> Path:
    """An honest zone, and WILD zones that all read the flooded key."""
    honest = {
        channel: {"source": "bus", locator: f"plant/{topic}", "unit": unit}
        for channel, (topic, unit, _) in HONEST.items()
    }
    wild = {"source": "bus", locator: "plant/wild", "unit": "degC", "format": "senml"}
    zones = [_zone("honest", honest)]
    zones += [_zone(f"wild-{k}", honest | {"T_i": wild | {"record": f"T{k}"}}) for k in range(WILD)]
    return _written(folder, source, zones)


@contextmanager
def _daemon(folder: Path, config: Path, key: str | None = None) -> Iterator[Daemon]:
    with Daemon(config, folder / "log", {}) as daemon:
        daemon.key = key
        daemon.wait(lambda zones: zones["honest"]["samples"] >= 5)
        yield daemon


@contextmanager
def on_mqtt(folder: Path) -> Iterator[tuple[Daemon, Callable[[Target], str]]]:
    """A daemon on a broker, and the flood of one topic there."""
    with ExitStack() as stack:
        site = stack.enter_context(broker(folder))
        party = stack.enter_context(Party(site.port))
        stack.enter_context(_telling(party.put))
        source = {"kind": "mqtt", "host": "127.0.0.1", "port": site.port}
        daemon = stack.enter_context(_daemon(folder, _on_bus(folder, source, "topic")))
        yield daemon, lambda target: _flooded(daemon, _mqtt_flood, str(site.port))


@contextmanager
def on_zenoh(folder: Path) -> Iterator[tuple[Daemon, Callable[[Target], str]]]:
    """A daemon that a publisher on Zenoh connects to, and the flood of one key there."""
    place = f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        source = {"kind": "zenoh", "mode": "peer", "listen": [place], "writers": ["*"]}
        running = Daemon(_on_bus(folder, source, "key"), folder / "log", {})
        daemon = stack.enter_context(running)
        daemon.url()
        session = stack.enter_context(opened({"mode": "client", "connect/endpoints": [place]}))
        stack.enter_context(_telling(session.put))
        daemon.wait(lambda zones: zones["honest"]["samples"] >= 5)
        yield daemon, lambda target: _flooded(daemon, _zenoh_flood, place)


def _flooded(daemon: Daemon, flood: Callable[[str], None], place: str) -> str:
    process = multiprocessing.get_context("spawn").Process(target=flood, args=(place,))
    process.start()
    process.join()
    assert process.exitcode == 0, "the attacker has failed"
    # What waits at the broker and in the daemon.
    time.sleep(5.0)
    status = daemon.get("/zones/honest")[1]["status"]
    assert not status["faults"], status["faults"]
    wild = Counter(daemon.get("/zones/wild-0")[1]["status"]["faults"])
    assert wild, "nothing of the flood has come"
    return f"{MESSAGES} messages of 64 kB; no fault of the honest zone, of the flooded one {dict(wild)}"


@contextmanager
def _posted(
    folder: Path, attack: Callable[[Target, str, str], str]
) -> Iterator[tuple[Daemon, Callable[[Target], str]]]:
    """A daemon to which an honest client posts, and `attack`, which is given the key of another one."""
    channels = {channel: {"source": "bus", "unit": unit} for channel, (_, unit, _) in HONEST.items()}
    config = _written(folder, {"kind": "http"}, [_zone("honest", channels), _zone("other", channels)])
    keys = folder / "state" / "keys.json"
    honest, tenant = create_key(keys, "honest", "write"), create_key(keys, "tenant", "write")
    reader = create_key(keys, "reader", "read")
    statuses: Counter[int] = Counter()
    body = json.dumps(
        {"readings": [{"channel": channel, "value": float(value)} for channel, (_, _, value) in HONEST.items()]}
    ).encode()
    ended = threading.Event()

    def tell(target: Target) -> None:
        while not ended.wait(0.2):
            with suppress(OSError):
                statuses[target.post("/zones/honest/readings", body, honest).status] += 1

    def attacked(target: Target) -> str:
        before = Counter(statuses)
        note = attack(target, tenant, "application/senml+json")
        seen = statuses - before
        assert seen.keys() <= {200}, f"the honest client saw {dict(seen)}"
        return f"{note}; the honest client saw {dict(seen)}"

    with Daemon(config, folder / "log", {}) as daemon:
        daemon.key = reader
        target = Target(int(daemon.url().rpartition(":")[2]))
        teller = threading.Thread(target=tell, args=(target,))
        teller.start()
        try:
            daemon.wait(lambda zones: zones["honest"]["samples"] >= 5)
            yield daemon, attacked
        finally:
            ended.set()
            teller.join()


def _again_and_again(target: Target, key: str, kind: str, body: bytes, **headers: str) -> str:
    end = time.monotonic() + SECONDS

    def post() -> Counter[int]:
        seen: Counter[int] = Counter()
        while time.monotonic() < end:
            seen[target.post("/zones/other/readings", body, key, kind, **headers).status] += 1
        return seen

    with ThreadPoolExecutor(8) as pool:
        seen = sum((done.result() for done in [pool.submit(post) for _ in range(8)]), Counter())
    # 0: there was no answer, which on a slow machine says nothing.
    assert seen.keys() <= {0, 200, 413, 422, 429, 503}, seen
    return f"{len(body)} bytes, {', '.join(f'{count} times {status}' for status, count in sorted(seen.items()))}"


def _packed_base_name(target: Target, key: str, kind: str) -> str:
    pack = [{"bn": "x" * 500_000}, *({"n": str(k), "v": 1} for k in range(19_990))]
    return _again_and_again(target, key, kind, gzip.compress(json.dumps(pack).encode()), Content_Encoding="gzip")


def _packed_values(target: Target, key: str, kind: str) -> str:
    pack = [{"bn": "\N{THERMOMETER}" * 200}, *({"n": str(k), "v": 1} for k in range(19_990))]
    return _again_and_again(target, key, kind, gzip.compress(json.dumps(pack).encode()), Content_Encoding="gzip")


def _never_ending(target: Target, key: str, kind: str) -> str:
    head = f"POST /readings HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {key}\r\nContent-Type: {kind}\r\n"
    held, opened_so_far, end = [], 0, time.monotonic() + SECONDS
    try:
        while time.monotonic() < end:
            while len(held) < 12:
                connection = target.connect(5)
                connection.sendall(f"{head}Content-Length: 1000\r\n\r\n[".encode())
                connection.settimeout(0.001)
                held.append(connection)
                opened_so_far += 1
            for connection in list(held):
                with suppress(TimeoutError):
                    if not connection.recv(1000):
                        held.remove(connection)
                        connection.close()
            time.sleep(0.05)
    finally:
        for connection in held:
            connection.close()
    return f"{opened_so_far} connections, twelve at a time"


ATTACKS: dict[str, Callable[[Path], Any]] = {
    "31.2 a flood on MQTT": on_mqtt,
    "31.2 a flood on Zenoh": on_zenoh,
    "31.1 a packed base name": lambda folder: _posted(folder, _packed_base_name),
    "31.1 20,000 packed values with wide names": lambda folder: _posted(folder, _packed_values),
    "31.4 posts that never end": lambda folder: _posted(folder, _never_ending),
}
"""For each, what runs a daemon in a folder, and gives it and the attack."""
