"""The Zenoh source against real sessions on loopback."""

import asyncio
import json
import socket
import threading
import time
from pathlib import Path
from typing import Any

import pytest
import zenoh
from support.sources import bound, source_table
from support.waiting import PATIENCE, between
from support.zenoh_plant import QUICK, TLS, USER, caching_publisher, certificates, endpoint, listening, opened, session

import adapters.messages.subscribed
import adapters.zenoh.source
from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.fields.times import written_to_the_millisecond as iso
from adapters.zenoh.source import ZenohSource

T = {"id": "room/T", "key": "bms/room/T"}
JSON = {"format": "json", "value": "/value", "time": "/time", "quality": "/quality"}
Keys = dict[str, Any]


@pytest.fixture
def place() -> str:
    return endpoint()


def source(where: str | Keys, *channels: Keys, **keys: Any) -> ZenohSource:
    """A source that connects to `where`, or has those keys; where it listens, everyone may put readings."""
    given = {"connect": [where]} if isinstance(where, str) else where
    everyone = {"writers": ["*"]} if "listen" in given else {}
    table = source_table("zenoh", **{"timeout": 1.0} | given | everyone | keys)
    return table.build("bms", [bound(table, **one) for one in channels or (T,)])


@pytest.mark.parametrize("ours", ["client", "peer", "listening peer", "listening router"])
async def test_client_peer_and_embedded_router(ours: str, place: str) -> None:
    if not ours.startswith("listening"):
        with session(listen=place) as bms:
            async with listening(source(place, mode=ours)) as heard:
                await heard.until(heard.values, lambda: bms.put("bms/room/T", "1"))
        return
    async with listening(source({"mode": ours.split()[1], "listen": [place]})) as heard:
        await opened(place)
        with session("client", connect=place) as bms, session("client", connect=place) as other:
            subscriber = other.declare_subscriber("bms/**")
            await heard.until(heard.values, lambda: bms.put("bms/room/T", "1"))
            if ours.endswith("router"):
                # It relays between its clients.
                await heard.until(lambda: subscriber.try_recv(), lambda: bms.put("bms/room/T", "1"))


async def test_what_is_missed_while_the_router_is_away_is_recovered(place: str) -> None:
    with session("router", listen=place) as router, session("client", connect=place, **QUICK) as bms:
        publisher = caching_publisher(bms, "bms/room/T")
        async with listening(source(place, recover=60.0)) as heard:
            await heard.until(lambda: heard.values(), lambda: publisher.put("0"))
            router.close()
            await asyncio.sleep(0.2)
            for number in range(1, 6):
                publisher.put(str(number))
            with session("router", listen=place):
                await heard.until(lambda: 5.0 in heard.values())
                publisher.put("6")
                await heard.until(lambda: 6.0 in heard.values())
            later = [value for value in heard.values() if value]
            assert later == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "each once, in order"


async def test_a_publisher_that_restarts_is_heard_again_with_what_it_published_before_we_were_back(
    monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    monkeypatch.setattr(adapters.zenoh.source, "LOST", 0.3)
    async with listening(source(place, recover=60.0)) as heard:
        for life in (1, 2):
            await heard.until(lambda life=life: len(heard.failures) >= life)
            with session(listen=place) as bms:
                publisher = caching_publisher(bms, "bms/room/T")
                for number in range(3):
                    publisher.put(str(10 * life + number))
                await heard.until(lambda life=life: 10.0 * life + 2 in heard.values())
        assert heard.values() == [10.0, 11.0, 12.0, 20.0, 21.0, 22.0]


async def verdict(connection: str | Keys, **keys: Any) -> str:
    """ "connected", or why not."""
    try:
        await source(connection, **keys).probe(0.3)
    except (SourceUnavailable, SourceConfigError) as error:
        return str(error)
    return "connected"


@pytest.mark.parametrize("mode", ["client", "peer"])
async def test_user_and_password_are_accepted_and_refused(
    mode: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    users, password = tmp_path / "users", tmp_path / "password"
    users.write_text("thermogate:secret-1\n", encoding="utf-8")
    password.write_text("secret-1\n", encoding="utf-8")
    mine = {f"{USER}user": "bms", f"{USER}password": "x", f"{USER}dictionary_file": str(users)}
    ours = {"mode": mode, "connect": [place], "user": "thermogate"}
    with session(listen=place, **mine):
        assert await verdict(ours, password_file=password) == "connected"
        monkeypatch.setenv("BMS_PASSWORD", "secret-1")
        assert await verdict(ours, password_env="BMS_PASSWORD", timeout=5.0) == "connected"
        password.write_text("secret-2\n", encoding="utf-8")
        refused = await verdict(ours, password_file=password)
        assert "check" in refused
        assert "user" in refused
        assert "secret" not in refused
        assert await verdict(place, mode=mode) != "connected"


async def test_a_host_that_is_no_name_is_one_at_which_nobody_answers() -> None:
    told = await verdict("tcp/192.168..30:7447", mode="client", timeout=1.0)
    assert told.endswith("no Zenoh session answers at tcp/192.168..30:7447; start it, or correct the address")


async def test_our_listener_asks_for_user_and_password(tmp_path: Path, place: str) -> None:
    (tmp_path / "users").write_text("bms:secret-1\n", encoding="utf-8")
    async with listening(source({"mode": "router", "listen": [place], "users_file": tmp_path / "users"})) as heard:
        await opened(place)
        wrong = {"connect/timeout_ms": 1000, f"{USER}user": "bms", f"{USER}password": "no"}
        with pytest.raises(zenoh.ZError), session("client", connect=place, **wrong):
            pass
        with session("client", connect=place, **{f"{USER}user": "bms", f"{USER}password": "secret-1"}) as bms:
            await heard.until(heard.values, lambda: bms.put("bms/room/T", "1"))


async def test_tls_and_mutual_tls_are_accepted_and_refused(tmp_path: Path) -> None:
    folder = certificates(tmp_path)
    server = {
        f"{TLS}listen_certificate": str(folder / "server.pem"),
        f"{TLS}listen_private_key": str(folder / "server.key"),
    }
    mutual = server | {f"{TLS}enable_mtls": True, f"{TLS}root_ca_certificate": str(folder / "ca.pem")}
    ca = folder / "ca.pem"

    def signed(name: str) -> Keys:
        return {"ca": ca, "certificate": folder / f"{name}.pem", "private_key": folder / f"{name}.key"}

    place = endpoint("tls")
    with session(listen=place, **server):
        assert await verdict(place, tls={"ca": ca}) == "connected"
        assert "certificates" in await verdict(place, tls={"ca": folder / "other.pem"})
        assert "certificates" in await verdict(place, tls=None)
    place = endpoint("tls")
    with session(listen=place, **mutual):
        assert await verdict(place, tls=signed("client")) == "connected"
        assert "certificates" in await verdict(place, tls={"ca": ca})
        assert "certificates" in await verdict(place, tls=signed("stranger"))


async def test_files_of_certificates_that_cannot_be_used_are_said_before_connecting(tmp_path: Path) -> None:
    folder = certificates(tmp_path)

    def problems(tls: Keys, **keys: object) -> list[str]:
        return source("tls/127.0.0.1:1", tls=tls, **keys).check()

    (missing,) = problems({"ca": folder / "nothing.pem"})
    assert missing == f"sources.bms: tls.ca: {folder}/nothing.pem cannot be read (no such file or directory)"
    (nonsense,) = problems({"ca": folder / "ca.key"})
    assert nonsense.endswith("/ca.key holds no certificate in PEM; give the certificate of the authority")
    (foreign,) = problems({"certificate": folder / "client.pem", "private_key": folder / "server.key"})
    assert "the unlocked key that belongs to it" in foreign
    (secret,) = problems({}, user="x", password_file=folder / "nothing")
    assert secret == f"sources.bms: password_file: {folder}/nothing cannot be read (no such file or directory)"
    assert "tls.ca" in await verdict("tls/127.0.0.1:1", tls={"ca": folder / "nothing.pem"})


@pytest.mark.parametrize(("key", "gist"), [("bms//T", "empty chunks"), ("/bms", "slashes"), ("bms/T?", "forbidden")])
def test_a_wrong_key_expression_is_one_sentence(key: str, gist: str) -> None:
    (problem,) = source("tcp/127.0.0.1:1", T | {"key": key}).check()
    assert problem.startswith(f'sources.bms: room/T: key "{key}" is no key expression: ')
    assert gist in problem
    assert "/root/" not in problem


async def test_an_address_in_use_is_said(place: str) -> None:
    with session(listen=place):
        assert f"listen: an address of {place} cannot be used" in await verdict({"mode": "peer", "listen": [place]})


async def test_a_listener_that_nobody_connects_to_stays_open_and_says_so(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, place: str
) -> None:
    monkeypatch.setattr(adapters.zenoh.source, "LOST", 0.1)
    monkeypatch.setattr(adapters.messages.subscribed, "LOOK", 0.05)
    async with listening(source({"mode": "peer", "listen": [place]})) as heard:
        await heard.until(lambda: "nobody has connected to" in caplog.text)
        with session("client", connect=place) as bms:
            await heard.until(heard.values, lambda: bms.put("bms/room/T", "1"))
        assert heard.failures == []


async def test_probe_takes_the_last_value_from_a_cache_or_a_query(place: str) -> None:
    begun = time.time()
    asked = {"id": "room/q", "key": "store/q"} | JSON
    with session(listen=place) as bms:
        publisher = caching_publisher(bms, "bms/room/T")
        publisher.put("21.5")

        def answer(query: zenoh.Query) -> None:
            with query:
                document = {"value": 3, "time": iso(time.time() - 60), "quality": "uncertain"}
                query.reply("store/q", json.dumps(document))

        with bms.declare_queryable("store/q", zenoh.handlers.Callback(answer, indirect=False)):
            good, queried = await source(place, T, asked).probe(1.0)
    assert (good.value, good.verdict, good.raw) == (21.5, "good", "21.5")
    assert between(begun, good.time, time.time())
    assert good.hints[0].endswith("by Zenoh's time stamp")
    assert queried.value == 3.0
    assert between(begun - 60, queried.time, time.time() - 60)
    assert queried.hints[0].endswith("by its payload")
    assert queried.verdict.startswith("uncertain")


async def test_cancelling_while_the_session_opens_waits_for_nobody() -> None:
    def opening() -> set[threading.Thread]:
        return {thread for thread in threading.enumerate() if thread.name == "library"}

    before = opening()
    # Somebody listens there, and never says a word.
    with socket.create_server(("127.0.0.1", 0)) as mute:
        mute.setblocking(False)
        ours = source(f"tcp/127.0.0.1:{mute.getsockname()[1]}", timeout=60.0)
        task = asyncio.ensure_future(anext(aiter(ours.batches(None))))
        talking, _ = await asyncio.get_running_loop().sock_accept(mute)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        (thread,) = opening() - before
        assert thread.daemon, "the loop has ended while the session still opens; neither may the process wait for it"
    talking.close()
    thread.join(PATIENCE)
    assert not thread.is_alive()
