"""Nobody on Zenoh passes off a forecast or a reading for a true one, but who is allowed to: every party a process."""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import zenoh
from support import sites
from support.harness import Daemon
from support.zenoh_parties import FORGED, TRUE, opened, party
from support.zenoh_plant import TLS, USER, certificates, endpoint, session

PEOPLE = ("router", "thermogate", "bms-gateway", "reader")
ALIVE = "thermogate/plant/room/alive"


def configuration(folder: Path, source: dict[str, Any], ours: dict[str, Any]) -> Path:
    """One zone with samples of one second."""
    places = {name: {"key": key} for name, key in zip(sites.UNITS, TRUE, strict=True)}
    bms = {"kind": "zenoh", "times": ["zenoh", "arrival"], "recover": "5s", **source}
    return sites.written(folder, {"bms": bms}, [sites.zone("room", "bms", places, hold_inputs="30s")], zenoh=ours)


class Seen(NamedTuple):
    """What a reader got from the daemon: payloads published and answered, whether a key was deleted, living zones."""

    published: set[bytes]
    answered: set[bytes]
    deleted: bool
    alive: set[str]

    @property
    def forged(self) -> bool:
        return self.deleted or FORGED.encode() in self.published | self.answered or self.alive != {ALIVE}


def read(reader: zenoh.Session, seconds: float, enough: Callable[[Seen], object] = lambda seen: True) -> Seen:
    """What `reader` gets within `seconds`, and on until that is `enough`."""
    handler = zenoh.handlers.RingChannel(10_000)
    subscriber = reader.declare_subscriber("thermogate/**", handler)
    tokens = reader.liveliness().declare_subscriber("thermogate/**", handler, history=True)
    began = time.monotonic()
    seen = Seen(set(), set(), False, set())
    while time.monotonic() < began + seconds or not (enough(seen) or time.monotonic() > began + 180):
        replies = reader.get("thermogate/**", timeout=1, consolidation=zenoh.ConsolidationMode.NONE)
        answered = {reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None}
        samples = list(iter(subscriber.try_recv, None))
        alive = {str(sample.key_expr) for sample in iter(tokens.try_recv, None)}
        alive |= {str(reply.ok.key_expr) for reply in reader.liveliness().get("thermogate/**") if reply.ok is not None}
        seen = Seen(
            seen.published | {sample.payload.to_bytes() for sample in samples},
            seen.answered | answered,
            seen.deleted or any(sample.kind == zenoh.SampleKind.DELETE for sample in samples),
            seen.alive | alive,
        )
        time.sleep(0.1)
    for declared in (subscriber, tokens):
        declared.undeclare()
    return seen


def real(seen: Seen) -> int:
    """How many forecasts of the zone were published."""
    bodies = [json.loads(payload) for payload in seen.published if payload and payload != FORGED.encode()]
    return sum("intervals" in body and body["zone"] == "room" for body in bodies)


def measured(daemon: Daemon) -> list[float]:
    """What was measured; on a busy machine an interval may have nothing."""
    return [row["y"] for row in daemon.history("room") if row["y"] is not None]


@contextmanager
def forgers(*settings: dict[str, object]) -> Iterator[None]:
    """Forgers with these settings, all of whom get a session."""
    with ExitStack() as stack:
        verdicts = [stack.enter_context(party("forger", one)) for one in settings]
        assert verdicts == ["opened"] * len(settings)
        yield


def test_the_forger_forges_where_nothing_is_denied() -> None:
    """What the other tests rely on: without access control all of it comes through."""
    place = endpoint()
    with session("router", listen=place) as plain, party("forger", {"mode": "client", "connect/endpoints": [place]}):
        forged = FORGED.encode()
        seen = read(plain, 1.0, lambda seen: forged in seen.published & seen.answered and seen.deleted)
        assert (forged in seen.published, forged in seen.answered, seen.deleted) == (True, True, True)
        assert seen.alive == {"thermogate/plant/forged/alive"}


def test_a_daemon_that_others_connect_to(tmp_path: Path) -> None:
    """On its own sessions: the visitor has an account and can connect, but only the writers' readings are taken."""
    readings, forecasts = endpoint(), endpoint()
    (tmp_path / "users").write_text("bms-gateway:one\nvisitor:two\nsecond:three\n", encoding="utf-8")
    writers = ["bms-gateway", "second"]
    source = {"mode": "router", "listen": [readings], "users_file": "users", "writers": writers}
    path = configuration(tmp_path, source, {"listen": [forecasts]})

    def account(name: str, password: str) -> dict[str, object]:
        user = {f"{USER}user": name, f"{USER}password": password}
        return {"mode": "client", "connect/endpoints": [readings], **user}

    with Daemon(path, tmp_path / "log", {"zenoh.enabled": True}) as daemon:
        daemon.url()
        with party("gateway", account("bms-gateway", "one")) as verdict, session("client", connect=forecasts) as reader:
            assert verdict == "opened"
            with forgers(account("visitor", "two"), {"mode": "client", "connect/endpoints": [forecasts]}):
                had = daemon.status("room")["samples"]
                daemon.until("room", lambda status: status["samples"] > had)
                seen = read(reader, 2.0, real)
                assert (real(seen) >= 1, seen.forged) == (True, False)
                assert set(measured(daemon)) == {float(TRUE["bms/T"])}
            with forgers(account("second", "three")):
                # Who may put readings can: what was true before may still fill an interval or two.
                daemon.wait(lambda zones: max(measured(daemon)) > float(TRUE["bms/T"]))


@pytest.mark.parametrize("shown", ["certificates", "passwords"])
def test_a_daemon_behind_the_router_of_the_site(shown: str, tmp_path: Path) -> None:
    """With the access control that is shipped: every party shows who it is and can do its task only."""
    place, site = _site(shown, tmp_path)
    at_router = {"mode": "client", "connect": [place], **site.daemon}
    path = configuration(tmp_path, at_router | site.source, at_router)
    with party("router", {"listen/endpoints": [place], **site.router}) as verdict:
        assert verdict == "opened"
        with party("forger", site.client("stranger") | {"connect/timeout_ms": 1000}) as refused:
            assert refused == "refused"
        with (
            Daemon(path, tmp_path / "log", {"zenoh.enabled": True}) as daemon,
            forgers(site.client("reader")),
            opened(site.client("reader")) as reader,
        ):
            # The gateway is known by its name for readings, and is nobody for forecasts.
            with party("gateway", site.client("bms-gateway")) as verdict:
                assert verdict == "opened"
                daemon.wait(lambda zones: zones["room"]["samples"] >= 1)
                seen = read(reader, 2.0, real)
                assert (real(seen) >= 1, seen.forged) == (True, False)
                assert set(measured(daemon)) == {float(TRUE["bms/T"])}
                assert reader.declare_subscriber("bms/**", zenoh.handlers.RingChannel(9)).try_recv() is None
            with forgers(site.client("bms-gateway")):
                assert not read(reader, 1.0).forged
                # Who may put readings can: what was true before may still fill an interval or two.
                daemon.wait(lambda zones: max(measured(daemon)) > float(TRUE["bms/T"]))


class Site(NamedTuple):
    """What each party shows: the router and clients in Zenoh's keys, the daemon, and its source besides, in those of
    its configuration."""

    router: dict[str, object]
    daemon: dict[str, object]
    source: dict[str, object]
    client: Callable[[str], dict[str, object]]


def _site(shown: str, folder: Path) -> tuple[str, Site]:
    if shown == "passwords":
        place = endpoint()
        users = folder / "users"
        users.write_text("".join(f"{name}:secret-{name}\n" for name in PEOPLE), encoding="utf-8")
        (folder / "password").write_text("secret-thermogate\n", encoding="utf-8")

        def account(name: str) -> dict[str, object]:
            user = {f"{USER}user": name, f"{USER}password": f"secret-{name}"}
            return {"mode": "client", "connect/endpoints": [place], **user}

        # The router knows nobody by certificate then.
        router = {f"{USER}dictionary_file": str(users), f"{TLS}enable_mtls": False}
        return place, Site(router, {"user": "thermogate", "password_file": "password"}, {}, account)
    place = endpoint("tls")
    certificates(folder, PEOPLE)

    def pair(name: str, side: str) -> dict[str, object]:
        files = {f"{side}_certificate": f"{name}.pem", f"{side}_private_key": f"{name}.key"}
        return {f"{TLS}{key}": str(folder / file) for key, file in files.items()}

    authority = {f"{TLS}root_ca_certificate": str(folder / "ca.pem"), f"{TLS}enable_mtls": True}

    def signed(name: str) -> dict[str, object]:
        return {"mode": "client", "connect/endpoints": [place], **authority, **pair(name, "connect")}

    tls = {"ca": "ca.pem", "certificate": "thermogate.pem", "private_key": "thermogate.key"}
    return place, Site(authority | pair("router", "listen"), {"tls": tls}, {"writers": ["router"]}, signed)
