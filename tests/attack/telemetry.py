"""Attacks by those who bring readings: on MQTT and on Zenoh, and over HTTP with a key of their own.

Each runs beside an honest publisher of the same source, whose zone may lose no interval. AssertionError where something
gave way.
"""

import gzip
import json
import multiprocessing
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

from attack.victim import Target, Victim, hammered, served
from support import sites
from support.broker import Party, broker
from support.harness import Daemon
from support.waiting import repeated
from support.zenoh_parties import opened
from support.zenoh_plant import endpoint

from service.web.keys import create_key

LONGEST = 65_536
MESSAGES = 1500
SECONDS = 15.0
ROOMS = 50
"""Zones that read the flooded key, or ask for the flooded value, as rooms do for the outdoor temperature."""

HONEST = {"T_i": ("plant/room", "20.5"), "T_out": ("plant/outside", "4"), "u_heat": ("plant/heating", "1500")}

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


def _flood(put: Put) -> None:
    for flood in FLOODS:
        for _ in range(MESSAGES // len(FLOODS)):
            put("plant/wild", flood())


def _mqtt_flood(place: str) -> None:
    with Party(int(place)) as party:
        _flood(party.put)
        # It is at the broker behind all the others.
        party.put("plant/wild", b"[]", qos=1)


def _zenoh_flood(place: str) -> None:
    with opened({"mode": "client", "connect/endpoints": [place]}) as session:
        _flood(session.put)
        # What was put is sent by other threads.
        time.sleep(1.0)


def _telling(put: Put) -> AbstractContextManager[None]:
    """Publish the honest values five times a second."""
    return repeated(lambda: [put(topic, value.encode()) for topic, value in HONEST.values()])


def _on_bus(folder: Path, source: dict[str, Any], locator: str) -> Path:
    """An honest zone, and ROOMS that all read the flooded key."""
    honest = {channel: {locator: topic} for channel, (topic, _) in HONEST.items()}
    wild = honest | {"T_out": {locator: "plant/wild", "format": "senml", "record": "T0"}}
    zones = [sites.zone("honest", "bus", honest, hold_inputs="20s"), *_rooms(wild)]
    return sites.written(folder, {"bus": source}, zones)


def _rooms(places: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    return [sites.zone(f"wild-{k}", "bus", places, period="1min", estimator="ekf") for k in range(ROOMS)]


@contextmanager
def on_mqtt(folder: Path) -> Iterator[tuple[Victim, Callable[[Target], str]]]:
    """A daemon on a broker, and the flood of one topic there."""
    with broker(folder) as site, Party(site.port) as party, _telling(party.put):
        source = {"kind": "mqtt", "host": "127.0.0.1", "port": site.port}
        with served(_on_bus(folder, source, "topic"), folder) as daemon:
            daemon.wait(_begun)
            yield Victim(daemon, "honest"), lambda target: _flooded(daemon, _mqtt_flood, str(site.port))


@contextmanager
def on_zenoh(folder: Path) -> Iterator[tuple[Victim, Callable[[Target], str]]]:
    """A daemon that a publisher on Zenoh connects to, and the flood of one key there."""
    place = endpoint()
    source = {"kind": "zenoh", "mode": "peer", "listen": [place], "writers": ["*"]}
    with served(_on_bus(folder, source, "key"), folder) as daemon:
        daemon.url()
        with opened({"mode": "client", "connect/endpoints": [place]}) as session, _telling(session.put):
            daemon.wait(_begun)
            yield Victim(daemon, "honest"), lambda target: _flooded(daemon, _zenoh_flood, place)


def _begun(zones: dict[str, Any]) -> bool:
    return zones["honest"]["samples"] >= 5


def _flooded(daemon: Daemon, flood: Callable[[str], None], place: str) -> str:
    process = multiprocessing.get_context("spawn").Process(target=flood, args=(place,))
    process.start()
    process.join()
    assert process.exitcode == 0, "the attacker has failed"
    # What waits at the broker and in the daemon.
    time.sleep(5.0)
    faults = daemon.status("honest")["faults"]
    assert not faults, faults
    wild = Counter(daemon.status("wild-0")["faults"])
    assert wild, "nothing of the flood has come"
    return f"{MESSAGES} messages of 64 kB; no fault of the honest zone, of the flooded one {dict(wild)}"


@contextmanager
def _posted(
    folder: Path, attack: Callable[[Target, str, str], str], rooms: bool = False
) -> Iterator[tuple[Victim, Callable[[Target], str]]]:
    """A daemon to which an honest client posts, and `attack`, which is given the key of another one; with ROOMS that
    ask for the value called outdoor."""
    zones = [sites.zone(name, "bus", {}, hold_inputs="20s") for name in ("honest", "other")]
    zones += _rooms({"T_out": {"name": "outdoor"}}) if rooms else []
    config = sites.written(folder, {"bus": {"kind": "http"}}, zones)
    keys = folder / "state" / "keys.json"
    honest, tenant = create_key(keys, "honest", "write"), create_key(keys, "tenant", "write")
    statuses: Counter[int] = Counter()
    readings = [{"channel": channel, "value": float(value)} for channel, (_, value) in HONEST.items()]
    body = json.dumps({"readings": readings}).encode()

    def tell() -> None:
        with suppress(OSError):
            statuses[target.post("/zones/honest/readings", body, honest).status] += 1

    def attacked(target: Target) -> str:
        before = Counter(statuses)
        note = attack(target, tenant, "application/senml+json")
        seen = statuses - before
        assert seen.keys() <= {200}, f"the honest client saw {dict(seen)}"
        return f"{note}; the honest client saw {dict(seen)}"

    with served(config, folder) as daemon:
        daemon.key = create_key(keys, "reader", "read")
        target = Target.of(daemon)
        with repeated(tell):
            daemon.wait(_begun)
            yield Victim(daemon, "honest"), attacked


def _packed(base_name: str) -> Callable[[Target, str, str], str]:
    """Posts of 20,000 values, packed, whose names begin with `base_name`, again and again."""
    return _again("/zones/other/readings", [{"bn": base_name}, *({"n": str(k), "v": 1} for k in range(19_990))])


def _again(path: str, pack: list[dict[str, Any]]) -> Callable[[Target, str, str], str]:
    """Posts of a `pack`, which is packed, again and again."""
    body = gzip.compress(json.dumps(pack).encode())

    def attack(target: Target, key: str, kind: str) -> str:
        request = target.request(path, body, key, kind, Content_Encoding="gzip")
        return f"{len(body)} bytes, " + hammered(target, [request], SECONDS, {200, 413, 422, 429, 503})

    return attack


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
    "31.1 a packed base name": lambda folder: _posted(folder, _packed("x" * 500_000)),
    "31.1 20,000 packed values with wide names": lambda folder: _posted(folder, _packed("\N{THERMOMETER}" * 200)),
    "31.2 a value that fifty rooms ask for": lambda folder: _posted(
        folder, _again("/readings", [{"n": "outdoor", "v": k % 30, "t": -k / 100} for k in range(1999)]), rooms=True
    ),
    "31.4 posts that never end": lambda folder: _posted(folder, _never_ending),
}
"""For each, what runs a daemon in a folder, and gives it and the attack."""
