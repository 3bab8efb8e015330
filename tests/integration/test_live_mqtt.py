"""The daemon on live MQTT: one broker floods, sends nonsense, goes away and comes back; the other's zone goes on."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support import sites
from support.broker import Mosquitto, Party, broker, flood
from support.harness import Daemon
from support.waiting import repeated, wait_until

TOPICS = {"T_i": ("home/room", "20.5"), "T_out": ("home/outside", "4"), "u_heat": ("home/heating", "1500")}


@contextmanager
def telling(site: Mosquitto) -> Iterator[Party]:
    """Publish every value five times a second."""
    with Party(site.port) as party, repeated(lambda: [party.put(*told) for told in TOPICS.values()]):
        yield party


def configuration(folder: Path, ports: dict[str, int]) -> Path:
    """A zone for each of the brokers at `ports`, and the forecasts on the one called calm."""
    places = {name: {"topic": topic} for name, (topic, _) in TOPICS.items()}
    sources = {name: {"kind": "mqtt", "host": "127.0.0.1", "port": port} for name, port in ports.items()}
    zones = [sites.zone(name, name, places) for name in ports]
    return sites.written(folder, sources, zones, mqtt={"host": "127.0.0.1", "port": ports["calm"]})


def counted_as_nonsense(daemon: Daemon, party: Party, payload: str | bytes) -> None:
    """Publish `payload` until it is counted: broker and source may each drop what comes behind a flood."""
    before = daemon.status("wild")["faults"].get("non_numeric", 0)
    published = float("-inf")

    def counted() -> bool:
        nonlocal published
        if time.monotonic() - published > 5:
            party.put("home/room", payload, qos=1)
            published = time.monotonic()
        return daemon.status("wild")["faults"].get("non_numeric", 0) > before

    wait_until(counted)


def test_what_one_broker_does_harms_no_zone_of_another(tmp_path: Path) -> None:
    for name in ("calm", "wild"):
        (tmp_path / name).mkdir()
    with (
        broker(tmp_path / "calm") as calm,
        broker(tmp_path / "wild") as wild,
        telling(calm),
        telling(wild) as party,
        Daemon(configuration(tmp_path, {"calm": calm.port, "wild": wild.port}), tmp_path / "log") as daemon,
    ):
        daemon.wait(lambda zones: all(zone["samples"] >= 3 for zone in zones.values()))
        before = daemon.status("calm")["samples"]
        flood(wild.port, "home/room", (str(1000 + k) for k in range(30_000)))
        for payload in (b"9" * (10 * 2**20), "warm", b"\xff"):
            counted_as_nonsense(daemon, party, payload)
        daemon.until("calm", lambda status: status["samples"] > before + 2)
        wild.stop()
        daemon.until("wild", lambda status: "no MQTT broker answers" in status["reason"])
        assert daemon.status("calm")["state"] == "running"
        samples = daemon.status("wild")["samples"]
        wild.start()
        daemon.until("wild", lambda status: status["samples"] > samples + 3 and status["reason"] == "")
        # A busy machine may be late, and nothing else.
        assert daemon.status("calm")["faults"].keys() <= {"out_of_order"}
        forecast = daemon.get("/zones/wild/forecast")[1]
        assert 15 < forecast["mean"] < 25, "what was nonsense has taught it nothing"
        with Party(calm.port, "thermogate/plant/#") as watching:
            wait_until(lambda: "thermogate/plant/wild/forecast" in watching.newest())
            assert json.loads(watching.newest()["thermogate/plant/calm/status"])["zone"] == "calm"
            assert watching.newest()["thermogate/plant/availability"] == b"online"
            assert "thermogate_mqtt_connected 1.0" in daemon.text("/metrics")
            daemon.kill()
            wait_until(lambda: watching.newest()["thermogate/plant/availability"] == b"offline")
