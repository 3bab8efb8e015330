"""The publisher, heard by a second Zenoh session on loopback."""

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import zenoh
from support.fake_zones import announced, make_update, running
from support.harness import ROOT
from support.processes import free_port
from support.publishing import opened, settings
from support.waiting import PATIENCE, wait_until
from support.zenoh_plant import session as session_of

from service.errors import ServiceError
from service.publish import zenoh as module
from service.publish.payloads import ForecastPayload
from service.publish.sinks import Occasion
from service.publish.zenoh import Publisher, ZenohConfig
from service.records.record import document

ACCEPTS = socket.SO_ACCEPTCONN
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


def heard(session: zenoh.Session, key: str) -> zenoh.Subscriber:
    return session.declare_subscriber(key, zenoh.handlers.RingChannel(100))


def receive(subscriber: zenoh.Subscriber, count: int) -> list[zenoh.Sample]:
    samples: list[zenoh.Sample] = []
    wait_until(lambda: samples.extend(iter(subscriber.try_recv, None)) or len(samples) >= count)
    return samples


def ask(session: zenoh.Session, selector: str) -> dict[str, bytes]:
    replies = list(session.get(f"thermogate/htwg/{selector}", timeout=180))
    return {str(reply.ok.key_expr)[16:]: reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None}


def settled(session: zenoh.Session, selector: str, count: int) -> dict[str, bytes]:
    """Answers to `selector`, once the queryables have become known to `session`."""
    return wait_until(lambda: found if len(found := ask(session, selector)) >= count else {})


def test_awaiting_a_subscriber_takes_every_zone(publisher: Publisher, session: zenoh.Session) -> None:
    one = heard(session, "thermogate/htwg/living/forecast")
    began = time.monotonic()
    assert not publisher.await_subscriber(0.3)
    assert time.monotonic() - began > 0.25
    other = heard(session, "thermogate/*/bedroom/*")
    assert publisher.await_subscriber(180)
    one.undeclare()
    other.undeclare()


def test_a_late_joiner_asks_for_the_last_values(publisher: Publisher, session: zenoh.Session) -> None:
    status = running("living").now().status
    publisher.publish(announced("bedroom", None, status._replace(state="waiting", reason="cold")))
    assert len(settled(session, "**", 1)) == 1
    assert ask(session, "living/forecast") == {}, "nothing before the first"
    for step in range(3):
        publisher.publish(announced("living", make_update(step), status))
    assert settled(session, "living/forecast", 1) == {
        "living/forecast": document(ForecastPayload.of(make_update(2)), "htwg", "living")
    }
    everything = settled(session, "**", 5)
    of_living = [f"living/{topic}" for topic in ("forecast", "gate", "status", "volatility")]
    assert sorted(everything) == ["bedroom/status", *of_living]
    assert json.loads(everything["bedroom/status"])["reason"] == "cold"


def test_an_address_in_use_is_one_sentence(publisher: Publisher, address: str) -> None:
    with pytest.raises(ServiceError) as caught:
        opened(settings(listen=(address,)), ["living"])
    assert str(caught.value) == (
        f"zenoh.listen: an address of {address} is in use by another process; choose another port, "
        "stop that process, or do without Zenoh (zenoh.enabled = false)"
    )


def test_a_site_that_says_nothing_of_zenoh_starts_without_it_where_the_address_is_in_use(
    publisher: Publisher, address: str, caplog: pytest.LogCaptureFixture
) -> None:
    class Usual(ZenohConfig):
        listen: tuple[str, ...] = (address,)

    assert module.KIND.open(Usual(), "first") is None
    assert caplog.messages == [
        f"zenoh.listen: an address of {address} is in use by another process; choose another port, stop that process, "
        "or do without Zenoh (zenoh.enabled = false); nothing is published on Zenoh"
    ]
    with pytest.raises(ServiceError, match="is in use by another process"):
        module.KIND.open(Usual(listen=(address,)), "first")


def test_a_mistaken_place_is_one_sentence(address: str) -> None:
    with pytest.raises(ServiceError, match=f"zenoh.connect: no Zenoh router answers at {address}"):
        opened(settings(mode="client", connect=(address,)), ["living"])
    with pytest.raises(ServiceError, match=r"\[zenoh\]: Zenoh does not take listen/endpoints") as caught:
        opened(settings().model_copy(update={"listen": ("nonsense",)}), ["living"])
    assert ".rs" not in str(caught.value)


def test_a_listener_with_users_asks_for_a_password_and_never_tells_it(address: str, tmp_path: Path) -> None:
    (tmp_path / "users").write_text("reader:hush\n", encoding="utf-8")
    config = ZenohConfig.model_validate({"listen": [address], "users_file": "users"}, context={"folder": tmp_path})
    publisher = opened(config, ["living"])
    publisher.publish(announced("living", make_update(0), running("living").now().status))
    user = "transport/auth/usrpwd"

    def reading(password: str) -> dict[str, bytes]:
        shown = {f"{user}/user": "reader", f"{user}/password": password, "connect/timeout_ms": 1000}
        with session_of("client", connect=address, **shown) as reader:
            return settled(reader, "living/forecast", 1)

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


def listening_ports() -> set[int]:
    """Ports of every socket of this process that listens, and of every one for datagrams."""
    ports = set()
    for link in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            if str(link.readlink()).startswith("socket:"):
                with socket.fromfd(int(link.name), socket.AF_INET, socket.SOCK_STREAM) as one:
                    kind, *listens = (one.getsockopt(socket.SOL_SOCKET, name) for name in (socket.SO_TYPE, ACCEPTS))
                    if kind == socket.SOCK_DGRAM or any(listens):
                        ports.add(one.getsockname()[1])
    return ports


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


def test_the_interpreter_ends_even_if_close_is_forgotten(address: str) -> None:
    script = (
        "import sys; sys.path[:0] = ['.', 'tests']\n"
        "from support.fake_zones import announced, make_update, running\n"
        "from support.publishing import opened, settings\n"
        f"publisher = opened(settings(listen=({address!r},)), ['living'])\n"
        "publisher.publish(announced('living', make_update(0), running('living').now().status))\n"
    )
    assert subprocess.run([sys.executable, "-c", script], cwd=ROOT, timeout=PATIENCE, check=False).returncode == 0


def test_a_forecast_that_nobody_vouches_for_is_put_again_as_bad(publisher: Publisher, session: zenoh.Session) -> None:
    subscriber, bedroom = (heard(session, f"thermogate/htwg/{zone}/forecast") for zone in ZONES)
    assert publisher.await_subscriber(180)
    zone, update = running("living"), make_update(2)
    publisher.publish(announced("living", update, zone.now().status))
    zone.state, zone.reason = "stalled", "T_out is 1500 s old"
    for _ in range(3):
        publisher.publish(announced("living", update, zone.now().status, Occasion.STATUS))
    (last,) = settled(session, "living/forecast", 1).values()
    zone.state = "running"
    publisher.publish(announced("living", make_update(3), zone.now().status))
    samples = receive(subscriber, 3)
    assert all(one.congestion_control == zenoh.CongestionControl.DROP for one in samples)
    assert {str(one.encoding) for one in samples} == {"application/json"}
    found = [json.loads(sample.payload.to_bytes()) for sample in samples]
    assert [one["quality"] for one in found] == ["good", "bad", "good"], "as bad it was put once"
    assert found[0] | {"quality": "bad"} == found[1] == json.loads(last)
    subscriber.undeclare()
    bedroom.undeclare()


def test_zones_come_and_go_and_are_alive_meanwhile(publisher: Publisher, session: zenoh.Session) -> None:
    tokens = session.liveliness().declare_subscriber(
        "thermogate/htwg/*/alive", zenoh.handlers.RingChannel(100), history=True
    )

    def told(count: int) -> list[tuple[str, bool]]:
        put = zenoh.SampleKind.PUT
        return sorted((str(sample.key_expr).split("/")[2], sample.kind == put) for sample in receive(tokens, count))

    assert told(2) == [("bedroom", True), ("living", True)]
    news = announced("attic", make_update(2), running("attic").now().status)
    publisher.publish(news)
    assert ask(session, "attic/*") == {}, "it is not published yet"
    publisher.add("attic")
    publisher.publish(news)
    assert set(settled(session, "attic/*", 4)) == {
        f"attic/{topic}" for topic in ("forecast", "volatility", "gate", "status")
    }
    publisher.remove("attic")
    publisher.remove("attic")
    publisher.publish(news)
    assert told(2) == [("attic", False), ("attic", True)]
    wait_until(lambda: ask(session, "attic/*") == {})
    publisher.close()
    assert told(2) == [("bedroom", False), ("living", False)]
    tokens.undeclare()
