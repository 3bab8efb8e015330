"""The publisher on MQTT, heard by clients of a real broker."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from support.broker import Mosquitto, Party, broker
from support.fake_zones import START, announced, make_update, running, waiting
from support.waiting import wait_until

from service.publish import mqtt
from service.publish.mqtt import MqttConfig, Publisher
from service.publish.sinks import TOPICS, Announcement, Occasion, Reports
from service.records.trust import HorizonTrust, Trust

AVAILABLE = "thermogate/htwg/availability"
LIVING = "thermogate/htwg/living/"


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Mosquitto]:
    with broker(tmp_path) as started:
        yield started


@contextmanager
def publishing(port: int, prefix: str | None = None, language: str = "en") -> Iterator[Publisher]:
    table = MqttConfig(host="127.0.0.1", port=port, client_id="thermogate-htwg", timeout=2.0)
    opened = Publisher(table, "htwg", prefix, language=language)
    opened.add("living")
    yield opened.open()
    opened.close()


def everything(name: str = "living", step: int = 2) -> Announcement:
    """An announcement with all there is to tell but a gain, which its estimator does not know."""
    zone = running(name)
    state = zone.now()._replace(update=make_update(step))
    return Announcement("htwg", name, state, Occasion.UPDATE, Reports(zone.skill(), trust=state.trust))


def test_who_comes_late_has_everything_at_once(site: Mosquitto) -> None:
    announcement = everything()
    told = {f"{LIVING}{topic}": announcement.payload(topic) for topic in announcement.topics}
    assert announcement.topics == tuple(topic for topic in TOPICS if topic not in ("gain", "ahead"))
    with publishing(site.port) as publisher:
        publisher.publish(announcement)
        with Party(site.port, "thermogate/#") as first:
            wait_until(lambda: first.newest() == told | {AVAILABLE: b"online"})
        with Party(site.port, "thermogate/#") as late:
            wait_until(lambda: late.newest() == told | {AVAILABLE: b"online"})
            assert all(retained for _, _, retained in late.came)
            publisher.close()
            wait_until(lambda: late.newest()[AVAILABLE] == b"offline")


def test_a_broker_that_was_away_has_the_newest_afterwards(site: Mosquitto, caplog: pytest.LogCaptureFixture) -> None:
    with publishing(site.port) as publisher:
        publisher.publish(everything(step=1))
        with Party(site.port, f"{LIVING}#") as watching:
            wait_until(lambda: f"{LIVING}forecast" in watching.newest())
        (connected, overtaken) = publisher.measures()
        assert list(connected.read()) == [((), 1.0)]
        site.stop()
        wait_until(lambda: "no MQTT broker answers" in caplog.text)
        assert list(connected.read()) == [((), 0.0)]
        for step in range(2, 100):
            publisher.publish(everything(step=step))
        assert len(publisher._last) == len(TOPICS) - 2, "the newest of each topic waits, and nothing else"
        # Nothing that it had retained has survived.
        site.start()
        newest = everything(step=99)
        with Party(site.port, f"{LIVING}#") as late:
            wait_until(lambda: late.newest().get(f"{LIVING}forecast") == newest.payload("forecast"))
        # Forecast, volatility and gate differed each time; all but the last were never sent.
        assert sum(value for _, value in overtaken.read()) >= 97 * 3
        site.stop()
    assert "[mqtt]: the connection to mqtt://127.0.0.1" in caplog.text
    assert publisher._background.wait(0), "it ends without a broker"


def test_what_nobody_expects_does_not_end_it(
    site: Mosquitto, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    outcomes = iter([RuntimeError("odd")])
    real = mqtt.connected

    def odd(*arguments: Any, **settings: Any) -> Any:
        for error in outcomes:
            raise error
        return real(*arguments, **settings)

    monkeypatch.setattr(mqtt, "connected", odd)
    with publishing(site.port), Party(site.port, AVAILABLE) as watching:
        wait_until(lambda: watching.newest().get(AVAILABLE) == b"online")
    assert "[mqtt]: the publisher failed: RuntimeError('odd'); trying again in 1 s" in caplog.text


def test_sentences_are_in_the_language_of_the_broker(site: Mosquitto) -> None:
    zone = running("living")
    reason = "the 95 % intervals 15 min ahead held 42 % of what came in 7 days"
    zone.trusted = Trust(START, (HorizonTrust(900, "untrusted", reason, START),))
    told = Announcement("htwg", "living", zone.now(), Occasion.UPDATE, Reports(trust=zone.trusted))
    with publishing(site.port, language="de") as publisher, Party(site.port, f"{LIVING}#") as watching:
        publisher.publish(told)
        wait_until(lambda: f"{LIVING}trust" in watching.newest())
        (horizon,) = json.loads(watching.newest()[f"{LIVING}trust"])["horizons"]
        assert horizon["reason"] == "die 95-%-Intervalle 15 min voraus enthielten 42 % dessen, was in 7 Tagen kam"
        assert {name: horizon[name] for name in ("lead_s", "trust")} == {"lead_s": 900, "trust": "untrusted"}
        wait_until(lambda: watching.newest().get(f"{LIVING}forecast") == told.payload("forecast"))


def test_a_zone_that_is_removed_is_forgotten(site: Mosquitto) -> None:
    everywhere = ("thermogate/#", "homeassistant/#")
    with publishing(site.port, "homeassistant") as publisher:
        publisher.add("bedroom")
        for name in ("living", "bedroom"):
            publisher.publish(everything(name))
        with Party(site.port, *everywhere) as watching:
            wait_until(lambda: sum("bedroom" in topic for topic in watching.newest()) > 20)
            publisher.remove("bedroom")
            publisher.publish(everything("bedroom", step=3))
            wait_until(lambda: not any(value for topic, value in watching.newest().items() if "bedroom" in topic))
        with Party(site.port, *everywhere) as late:
            wait_until(lambda: f"{LIVING}status" in late.newest() and len(late.newest()) > 20)
            assert not any("bedroom" in topic for topic in late.newest())
        publisher.remove("bedroom")


def test_a_forecast_that_nobody_vouches_for_is_told_bad_once(site: Mosquitto) -> None:
    zone = running("living")
    with publishing(site.port) as publisher, Party(site.port, f"{LIVING}forecast") as watching:
        publisher.publish(everything())
        wait_until(lambda: len(watching.came) == 1)
        zone.state, zone.reason = "stalled", "no measurement of T_i"
        for _ in range(3):
            publisher.publish(announced("living", make_update(2), zone.now().status, Occasion.STATUS))
            wait_until(lambda: len(watching.came) == 2)
        publisher.publish(everything(step=3))
        wait_until(lambda: len(watching.came) == 3)
    assert [json.loads(payload)["quality"] for _, payload, _ in watching.came] == ["good", "bad", "good"]


def test_a_zone_without_an_update_tells_its_status(site: Mosquitto) -> None:
    def entities(party: Party) -> set[str]:
        told = {topic for topic, payload in party.newest().items() if payload}
        return {topic.split("/")[-2] for topic in told if topic.endswith("/config")}

    with publishing(site.port, "homeassistant") as publisher, Party(site.port, "#") as watching:
        publisher.publish(announced("living", None, waiting("living").now().status))
        wait_until(lambda: f"{LIVING}status" in watching.newest())
        wait_until(lambda: entities(watching) == {"state", "last_sample", "problem"})
