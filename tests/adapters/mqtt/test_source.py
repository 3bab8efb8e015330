"""The MQTT source against mosquitto on loopback."""

from __future__ import annotations

import asyncio
import json
import subprocess
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from support.broker import Mosquitto, Party, broker
from support.processes import program
from support.sources import bound, source_table
from support.tables import tabled
from support.waiting import until
from support.zenoh_plant import certificates, listening

import adapters.messages.subscribed
import adapters.mqtt.broker
import adapters.mqtt.source
from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.fields.times import written_to_the_millisecond as iso
from adapters.mqtt.broker import VERSIONS
from adapters.mqtt.source import MqttSource
from adapters.reading import Quality
from adapters.scanning import Scan, Scannable

TOPIC = "home/room/T"
T = {"id": "room/T", "topic": TOPIC, "unit": "degC"}
DATED = T | {"format": "json", "value": "/value", "time": "/time"}
OTHER = {"id": "room/other", "topic": "home/other"}
HEAT = {"id": "room/u", "topic": "home/other"}

Channel = dict[str, Any]


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mosquitto]:
    with broker(tmp_path_factory.mktemp("broker")) as started:
        yield started


@pytest.fixture
def party(running: Mosquitto) -> Iterator[Party]:
    """Somebody who publishes; what was retained is gone afterwards."""
    with Party(running.port) as publishing:
        yield publishing
        for topic in (TOPIC, "home/other", "home/meter"):
            publishing.put(topic, "", retain=True, qos=1)


def source(port: int, *channels: Channel, name: str = "bms", **keys: Any) -> MqttSource:
    given = {"host": "127.0.0.1", "port": port, "client_id": f"test-{time.monotonic_ns()}", "timeout": 2.0} | keys
    table = source_table("mqtt", name, **given)
    return table.build(name, [bound(table, **one) for one in channels or (T,)])


async def test_a_retained_value_is_uncertain_and_gives_way_to_what_is_new(running: Mosquitto, party: Party) -> None:
    party.put(TOPIC, "18", retain=True, qos=1)
    party.put("home/meter", "1000", retain=True, qos=1)
    watched = source(running.port, T, {"id": "room/u", "topic": "home/meter", "unit": "J", "to": "W"})
    async with listening(watched) as heard:
        await heard.until(heard.readings.__len__)
        assert [(one.value, one.quality) for one in heard.readings] == [(18.0, Quality.UNCERTAIN)]
        # The counter's retained value has no known time, so the first power is made of two later ones.
        party.put("home/meter", "1001", qos=1)
        await asyncio.sleep(0.01)
        party.put("home/meter", "1002", qos=1)
        party.put(TOPIC, "21", qos=1)
        await heard.until(lambda: len(heard.readings) == 3)
        assert [one.quality for one in heard.readings if one.channel == "room/u"] == [Quality.GOOD]
        assert heard.values() == [18.0, 21.0]
    # After a reconnect the broker sends it again; by then it is known to be old.
    async with listening(watched) as again:
        await again.until(lambda: again.batches)
        party.put(TOPIC, "22", qos=1)
        await again.until(again.values)
        assert again.values() == [22.0]


@pytest.mark.parametrize("version", VERSIONS)
async def test_what_has_a_time_waits_at_the_broker_and_what_has_none_does_not(
    running: Mosquitto, party: Party, version: str
) -> None:
    watched = source(running.port, DATED, HEAT, version=version)
    async with listening(watched) as heard:
        await heard.until(lambda: heard.batches)
    missed = time.time() - 30
    for k in range(50):
        party.put(TOPIC, json.dumps({"value": k, "time": iso(missed + k / 10)}), qos=1)
        party.put("home/other", str(k), qos=1)
    async with listening(watched) as again:
        await again.until(lambda: len(again.values()) >= 50)
        assert again.values() == list(range(50))
        assert [one.time for one in again.readings] == pytest.approx([missed + k / 10 for k in range(50)], abs=0.001)
        assert again.values("room/u") == [], "it would be dated wrongly"


async def test_without_a_session_nothing_waits(running: Mosquitto, party: Party) -> None:
    watched = source(running.port, DATED, session=0)
    for value in (1, 2):
        async with listening(watched) as heard:
            await heard.until(lambda heard=heard: heard.batches)
            if value == 2:
                party.put(TOPIC, json.dumps({"value": value, "time": iso(time.time())}), qos=1)
                await heard.until(heard.values)
                assert heard.values() == [2.0]
        party.put(TOPIC, json.dumps({"value": value, "time": iso(time.time())}), qos=1)


async def test_a_broker_that_restarts_is_come_back_to(tmp_path: Path) -> None:
    with broker(tmp_path) as restarting, Party(restarting.port) as party:
        async with listening(source(restarting.port)) as heard:
            await heard.until(heard.values, lambda: party.put(TOPIC, "20"))
            restarting.stop()
            await heard.until(lambda: any("no MQTT broker answers" in failure for failure in heard.failures))
            lost = f"sources.bms: the connection to mqtt://127.0.0.1:{restarting.port} is lost ("
            assert heard.failures[0].startswith(lost)
            restarting.start()
            await heard.until(lambda: 21.0 in heard.values(), lambda: party.put(TOPIC, "21"))


class Unconfirmed:
    """A client whose broker does not confirm the second subscription of the first connection."""

    def __init__(self) -> None:
        self.asked: list[list[str]] = []
        """The topics of the subscriptions, by connection."""
        self.check = lambda: None

    @asynccontextmanager
    async def connected(self, *_: object) -> AsyncIterator[Unconfirmed]:
        self.asked.append([])
        yield self

    async def subscribe(self, topics: dict[str, int]) -> None:
        more = bool(self.asked[-1])
        self.asked[-1] += topics
        if more and len(self.asked) == 1:
            raise SourceUnavailable("Operation timed out")

    async def unsubscribe(self, topics: set[str]) -> None:
        pass

    async def close(self) -> None:
        pass


async def test_a_change_of_subscriptions_that_fails_opens_the_connection_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    client = Unconfirmed()
    monkeypatch.setattr(adapters.mqtt.source, "connected", client.connected)
    monkeypatch.setattr(adapters.messages.subscribed, "LOOK", 0.05)
    watched = source(1, T)
    meter = {"id": "room/u", "topic": "home/meter"}
    known, more, still_more = (bound(watched._table, **one) for one in (T, OTHER, meter))
    async with listening(watched) as heard:
        await heard.until(lambda: heard.batches)
        watched.rebind([known, more])
        await heard.until(lambda: heard.failures)
        assert "Operation timed out" in heard.failures[0]
        await heard.until(lambda: len(client.asked) == 2)
        watched.rebind([known, more, still_more])
        await heard.until(lambda: len(client.asked[1]) == 3)
        assert len(heard.failures) == 1
    assert client.asked == [[TOPIC, "home/other"], [TOPIC, "home/other", "home/meter"]]


async def test_probe_shows_what_is_there_and_what_is_elsewhere(running: Mosquitto, party: Party) -> None:
    party.put(TOPIC, "20.5", retain=True, qos=1)
    party.put("home/other", '{"temperature": 19.5, "linkquality": 80}', retain=True, qos=1)
    probes = await source(running.port, T, {"id": "room/u", "topic": "home/heater"}).probe(1.0)
    assert (probes[0].verdict, probes[0].place) == ("good", "home/room/T plain")
    assert probes[1].verdict.endswith("nothing was retained; check topic, and that it is published")
    assert probes[0].hints == ("retained: the broker had kept it, and its age is not known",)
    assert probes[1].hints[0] == "heard meanwhile: home/other with /temperature 19.5, /linkquality 80"
    assert "heard meanwhile: home/room/T with 20.5" in probes[1].hints


async def test_a_scan_lists_every_topic_and_its_numbers(running: Mosquitto, party: Party) -> None:
    party.put(TOPIC, "20.5", retain=True, qos=1)
    party.put("home/other", '{"temperature": 19.5, "state": {"battery": 80}}', retain=True, qos=1)
    party.put("home/meter", "on", retain=True, qos=1)
    # What Thermogate publishes itself is nothing to learn from.
    party.put("thermogate/site/room/forecast", '{"mean": 21.0}', retain=True, qos=1)
    party.put("homeassistant/sensor/thermogate_site_room/mean/config", '{"precision": 1}', retain=True, qos=1)
    searching = source_table("mqtt", host="127.0.0.1", port=running.port, timeout=2.0).build("bms", [])
    assert isinstance(searching, Scannable)
    found = await searching.scan(Scan(seconds=1.0))
    assert found.rows == [
        ("topic", "pointer", "number", "came"),
        ("home/other", "/temperature", "19.5", "retained"),
        ("home/other", "/state/battery", "80", "retained"),
        (TOPIC, "-", "20.5", "retained"),
    ]
    assert found.remarks == ["topics without a number: 1 (home/meter)"]


async def test_the_status_of_the_source_is_told_where_it_is_wanted(running: Mosquitto) -> None:
    with Party(running.port, "home/thermogate") as watching:
        async with listening(source(running.port, T, status_topic="home/thermogate")) as heard:
            await heard.until(lambda: watching.newest().get("home/thermogate") == b"online")
        await until(lambda: watching.newest()["home/thermogate"] == b"offline")
        watching.put("home/thermogate", "", retain=True, qos=1)


async def test_another_client_of_the_same_name_is_among_the_reasons(running: Mosquitto) -> None:
    async with listening(source(running.port, client_id="twin")) as heard:
        await heard.until(lambda: heard.batches)
        async with listening(source(running.port, client_id="twin")):
            await heard.until(lambda: heard.failures)
        remedy = 'check that the broker is on, and that no other client has the client_id "twin"'
        assert heard.failures[0].endswith(remedy)


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Mosquitto, Path]]:
    """A broker with TLS that wants a user and a password, and the folder with certificates and passwords."""
    folder = certificates(tmp_path_factory.mktemp("guarded"))
    (folder / "right").write_text("s3cret\n", encoding="utf-8")
    (folder / "wrong").write_text("guess\n", encoding="utf-8")
    passwords = folder / "passwords"
    subprocess.run([program("mosquitto_passwd", "mosquitto"), "-c", "-b", passwords, "bms", "s3cret"], check=True)
    listener = (f"cafile {folder}/ca.pem", f"certfile {folder}/server.pem", f"keyfile {folder}/server.key")
    with broker(folder, "allow_anonymous false", f"password_file {passwords}", listener=listener) as started:
        yield started, folder


@pytest.mark.parametrize("version", VERSIONS)
async def test_tls_with_user_and_password(guarded: tuple[Mosquitto, Path], version: str) -> None:
    running, folder = guarded

    def known(client: Any) -> None:
        client.username_pw_set("bms", "s3cret")
        client.tls_set(str(folder / "ca.pem"))

    tls = {"ca": folder / "ca.pem"}
    watched = source(running.port, tls=tls, user="bms", password_file=folder / "right", version=version)
    with Party(running.port, connect=known) as party:
        async with listening(watched) as heard:
            await heard.until(heard.values, lambda: party.put(TOPIC, "21.5"))
            assert heard.failures == []


@pytest.mark.parametrize("version", VERSIONS)
@tabled
async def test_what_the_broker_refuses_is_a_sentence(
    guarded: tuple[Mosquitto, Path], settings: dict[str, Any], sentence: str, version: str
) -> None:
    running, folder = guarded
    given = {"tls": {"ca": folder / "ca.pem"}, "user": "bms", "password_file": "right", "version": version} | settings
    given["password_file"] = folder / given["password_file"]
    with pytest.raises(SourceUnavailable, match=r"^sources\.bms: ") as refused:
        await anext(source(running.port, **given).batches(None))
    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value)


async def test_a_missing_library_is_said_before_connecting(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is wrong with files of passwords and certificates is the same for every kind; see those of Zenoh."""
    monkeypatch.setattr(adapters.mqtt.broker, "find_spec", lambda name: None)
    sentence = "sources.bms: MQTT needs the package paho-mqtt; install it with pip install 'thermogate[mqtt]'"
    assert source(1).check() == [sentence]
    with pytest.raises(SourceConfigError, match="needs the package paho-mqtt"):
        await anext(source(1).batches(None))
