"""The publisher, heard by a second Zenoh session on loopback."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from support.fake_zones import announced, make_update, running
from support.processes import free_port
from support.publishing import opened, settings
from support.zenoh_plant import session as session_of

from service.errors import ServiceError
from service.publish import zenoh as module
from service.publish.payloads import ForecastPayload
from service.publish.sinks import Occasion
from service.publish.zenoh import Publisher, ZenohConfig
from service.records.record import document

ZONES = ["living", "bedroom"]


@pytest.fixture
def address() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def publisher(address: str) -> Iterator[Publisher]:
    publisher = opened(settings(listen=(address,)), ZONES)
    yield publisher
    publisher.close()


@pytest.fixture
def session(publisher: Publisher, address: str) -> Iterator[zenoh.Session]:
    with session_of("peer", connect=address) as opened_session:
        yield opened_session


def receive(subscriber: zenoh.Subscriber, count: int, timeout: float = 240) -> list[zenoh.Sample]:
    samples: list[zenoh.Sample] = []
    deadline = time.monotonic() + timeout
    while len(samples) < count and time.monotonic() < deadline:
        sample = subscriber.try_recv()
        if sample is None:
            time.sleep(0.005)
        else:
            samples.append(sample)
    return samples


def ask(session: zenoh.Session, selector: str) -> dict[str, bytes]:
    replies = list(session.get(selector, timeout=180))
    return {str(reply.ok.key_expr): reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None}


def settled(session: zenoh.Session, selector: str, count: int) -> dict[str, bytes]:
    """Answers to `selector`, once the queryables have become known to `session`."""
    deadline = time.monotonic() + 180
    while len(found := ask(session, selector)) < count and time.monotonic() < deadline:
        time.sleep(0.02)
    return found


def test_an_update_arrives_on_four_keys_as_json(publisher: Publisher, session: zenoh.Session) -> None:
    subscriber = session.declare_subscriber("thermogate/htwg/**", zenoh.handlers.RingChannel(100))
    assert publisher.await_subscriber(180)
    zone, update = running("living"), make_update(2)
    publisher.publish(announced("living", update, zone.now().status))
    samples = receive(subscriber, 4)
    subscriber.undeclare()
    found = {str(sample.key_expr).rsplit("/", 1)[1]: sample for sample in samples}
    assert set(found) == {"forecast", "volatility", "gate", "status"}
    assert {str(sample.key_expr).rsplit("/", 1)[0] for sample in samples} == {"thermogate/htwg/living"}
    assert {str(sample.encoding) for sample in samples} == {"application/json"}
    assert all(sample.congestion_control == zenoh.CongestionControl.DROP for sample in samples)
    assert found["forecast"].payload.to_bytes() == document(ForecastPayload.of(update), "htwg", "living")
    assert json.loads(found["status"].payload.to_bytes())["outcome"] == "assimilated"


def test_awaiting_a_subscriber_takes_every_zone(publisher: Publisher, session: zenoh.Session) -> None:
    assert not publisher.await_subscriber(0.0)
    one = session.declare_subscriber("thermogate/htwg/living/forecast", zenoh.handlers.RingChannel(10))
    began = time.monotonic()
    assert not publisher.await_subscriber(0.3)
    assert time.monotonic() - began > 0.25
    other = session.declare_subscriber("thermogate/*/bedroom/*", zenoh.handlers.RingChannel(10))
    assert publisher.await_subscriber(180)
    one.undeclare()
    other.undeclare()


def test_a_late_joiner_asks_for_the_last_values(publisher: Publisher, session: zenoh.Session) -> None:
    status = running("living").now().status
    publisher.publish(announced("bedroom", None, status._replace(state="waiting", reason="cold")))
    assert len(settled(session, "thermogate/htwg/**", 1)) == 1
    assert ask(session, "thermogate/htwg/living/forecast") == {}, "nothing before the first"
    for step in range(3):
        publisher.publish(announced("living", make_update(step), status))
    (forecast,) = settled(session, "thermogate/htwg/living/forecast", 1).values()
    assert forecast == document(ForecastPayload.of(make_update(2)), "htwg", "living")
    everything = settled(session, "thermogate/htwg/**", 5)
    assert sorted(key.removeprefix("thermogate/htwg/") for key in everything) == [
        "bedroom/status",
        "living/forecast",
        "living/gate",
        "living/status",
        "living/volatility",
    ]
    assert json.loads(everything["thermogate/htwg/bedroom/status"])["reason"] == "cold"


def test_liveliness_ends_with_the_publisher(publisher: Publisher, session: zenoh.Session) -> None:
    subscriber = session.liveliness().declare_subscriber(
        "thermogate/htwg/*/alive", zenoh.handlers.RingChannel(100), history=True
    )
    alive = receive(subscriber, 2)
    assert {str(sample.key_expr) for sample in alive} == {f"thermogate/htwg/{zone}/alive" for zone in ZONES}
    assert all(sample.kind == zenoh.SampleKind.PUT for sample in alive)
    publisher.close()
    gone = receive(subscriber, 2)
    assert len(gone) == 2
    assert all(sample.kind == zenoh.SampleKind.DELETE for sample in gone)
    subscriber.undeclare()


def test_an_address_in_use_is_one_sentence(publisher: Publisher, address: str) -> None:
    with pytest.raises(ServiceError) as caught:
        opened(settings(listen=(address,)), ["living"])
    assert str(caught.value) == (
        f"zenoh.listen: an address of {address} is in use by another process; choose another port, "
        "stop that process, or do without Zenoh (zenoh.enabled = false)"
    )


def test_a_client_without_a_router_is_one_sentence(address: str) -> None:
    with pytest.raises(ServiceError, match=f"zenoh.connect: no Zenoh router answers at {address}"):
        opened(settings(mode="client", connect=(address,)), ["living"])


def test_a_listener_with_users_asks_for_a_password_and_never_tells_it(address: str, tmp_path: Path) -> None:
    (tmp_path / "users").write_text("reader:hush\n", encoding="utf-8")
    config = ZenohConfig.model_validate({"listen": [address], "users_file": "users"}, context={"folder": tmp_path})
    publisher = opened(config, ["living"])
    publisher.publish(announced("living", make_update(0), running("living").now().status))
    user = "transport/auth/usrpwd"

    def reading(password: str) -> dict[str, bytes]:
        shown = {f"{user}/user": "reader", f"{user}/password": password, "connect/timeout_ms": 1000}
        with session_of("client", connect=address, **shown) as reader:
            return settled(reader, "thermogate/htwg/living/forecast", 1)

    try:
        assert reading("hush")
        with pytest.raises(zenoh.ZError):
            reading("wrong")
    finally:
        publisher.close()
    (tmp_path / "password").write_text("wrong", encoding="utf-8")
    told = {"mode": "client", "connect": [address], "user": "reader", "password_file": "password", "timeout": "1s"}
    with session_of("router", listen=address, **{f"{user}/dictionary_file": str(tmp_path / "users")}):
        config = ZenohConfig.model_validate(told, context={"folder": tmp_path})
        with pytest.raises(ServiceError, match=r"zenoh.connect: .* check user and password") as caught:
            opened(config, ["living"])
        assert "wrong" not in str(caught.value)
    (tmp_path / "password").unlink()
    with pytest.raises(ServiceError, match=r"\[zenoh\]: password_file: .* cannot be read"):
        opened(config, ["living"])


def test_a_malformed_locator_is_one_sentence() -> None:
    with pytest.raises(ServiceError, match=r"\[zenoh\]: Zenoh does not take listen/endpoints") as caught:
        opened(settings().model_copy(update={"listen": ("nonsense",)}), ["living"])
    assert ".rs" not in str(caught.value)


def listening_ports() -> set[int]:
    """Ports of every TCP socket of this process that listens, IPv4 and IPv6."""
    inodes = set()
    for link in Path("/proc/self/fd").iterdir():
        try:
            target = str(link.readlink())
        except FileNotFoundError:
            continue
        if target.startswith("socket:["):
            inodes.add(target[8:-1])
    ports = set()
    for table in ("/proc/self/net/tcp", "/proc/self/net/tcp6", "/proc/self/net/udp", "/proc/self/net/udp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            fields = line.split()
            # State 0A is LISTEN; a bound datagram socket is 07.
            if fields[3] in ("0A", "07") and fields[9] in inodes:
                ports.add(int(fields[1].rsplit(":", 1)[1], 16))
    return ports


@pytest.mark.skipif(not Path("/proc/self/net/tcp").exists(), reason="needs /proc")
@pytest.mark.parametrize("configured", [True, False])
def test_it_listens_nowhere_else(configured: bool, address: str) -> None:
    before = listening_ports()
    publisher = opened(settings(listen=(address,) if configured else ()), ["living"])
    bound = listening_ports() - before
    publisher.close()
    assert bound == ({int(address.rsplit(":", 1)[1])} if configured else set())


def test_nothing_happens_after_close(publisher: Publisher) -> None:
    publisher.close()
    publisher.close()
    publisher.publish(announced("living", make_update(0), running("living").now().status))
    assert not publisher.await_subscriber(1.0)


def test_a_failed_session_is_reported(publisher: Publisher) -> None:
    publisher._session.close()
    with pytest.raises(ServiceError, match="thermogate/htwg/living/forecast cannot be published"):
        publisher.publish(announced("living", make_update(0), running("living").now().status))


def test_a_close_that_hangs_is_left_behind(
    publisher: Publisher, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    release = threading.Event()
    undeclare = publisher._undeclare
    monkeypatch.setattr(publisher, "_undeclare", lambda: (release.wait(180), undeclare()))
    monkeypatch.setattr(module, "_CLOSE_SECONDS", 0.1)
    publisher.close()
    assert not release.is_set()
    assert "did not close" in caplog.text
    release.set()
    for thread in threading.enumerate():
        if thread.name == "zenoh-close":
            thread.join(180)


@pytest.mark.parametrize("close", [True, False])
def test_the_interpreter_ends_even_if_close_is_forgotten(close: bool, address: str) -> None:
    script = (
        "import sys; sys.path[:0] = ['.', 'tests']\n"
        "from support.fake_zones import announced, make_update, running\n"
        "from support.publishing import opened, settings\n"
        f"publisher = opened(settings(listen=({address!r},)), ['living'])\n"
        "publisher.publish(announced('living', make_update(0), running('living').now().status))\n"
        f"{'publisher.close()' if close else ''}\n"
    )
    root = Path(__file__).parents[3]
    assert subprocess.run([sys.executable, "-c", script], cwd=root, timeout=120, check=False).returncode == 0


def test_a_forecast_that_nobody_vouches_for_is_put_again_as_bad(publisher: Publisher, session: zenoh.Session) -> None:
    subscriber = session.declare_subscriber("thermogate/htwg/living/forecast", zenoh.handlers.RingChannel(100))
    waiting = session.declare_subscriber("thermogate/htwg/bedroom/forecast", zenoh.handlers.RingChannel(100))
    assert publisher.await_subscriber(180)
    zone, update = running("living"), make_update(2)
    publisher.publish(announced("living", update, zone.now().status))
    zone.state, zone.reason = "stalled", "T_out is 1500 s old"
    for _ in range(3):
        publisher.publish(announced("living", update, zone.now().status, Occasion.STATUS))
    found = [json.loads(sample.payload.to_bytes()) for sample in receive(subscriber, 2)]
    assert [one["quality"] for one in found] == ["good", "bad"]
    assert found[0] | {"quality": "bad"} == found[1]
    (last,) = settled(session, "thermogate/htwg/living/forecast", 1).values()
    assert json.loads(last)["quality"] == "bad"
    # The next sample makes it good again.
    zone.state = "running"
    publisher.publish(announced("living", make_update(3), zone.now().status))
    (again,) = receive(subscriber, 1)
    # Which comes next: as bad it was put once, not three times.
    assert json.loads(again.payload.to_bytes())["quality"] == "good"
    subscriber.undeclare()
    waiting.undeclare()


def test_zones_come_and_go(publisher: Publisher, session: zenoh.Session) -> None:
    status, update = running("attic").now().status, make_update(2)
    publisher.publish(announced("attic", update, status))
    assert ask(session, "thermogate/htwg/attic/*") == {}, "it is not published yet"
    publisher.add("attic")
    publisher.publish(announced("attic", update, status))
    assert set(settled(session, "thermogate/htwg/attic/*", 4)) == {
        f"thermogate/htwg/attic/{topic}" for topic in ("forecast", "volatility", "gate", "status")
    }
    tokens = {str(reply.ok.key_expr) for reply in session.liveliness().get("thermogate/htwg/*/alive") if reply.ok}
    assert "thermogate/htwg/attic/alive" in tokens
    publisher.remove("attic")
    publisher.remove("attic")
    publisher.publish(announced("attic", update, status))
    deadline = time.monotonic() + 180
    while (found := ask(session, "thermogate/htwg/attic/*")) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert found == {}
