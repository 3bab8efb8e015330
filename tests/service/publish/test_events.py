"""Server-sent events on the real HTTP server: what is sent, who is too slow, who comes back, who leaves, who stops."""

import asyncio
import json
import socket
import time
from contextlib import asynccontextmanager

from prometheus_client import CollectorRegistry
from support.fake_zones import PERIOD, START, announced, make_update, running
from support.running_zone import Announced
from support.served import Client, config, serving
from support.waiting import PATIENCE, until

import service.publish.events
from service.forecast.ahead import LookingAhead
from service.publish.events import Event, Stream, Streams
from service.publish.payloads import ForecastPayload, GatePayload, VolatilityPayload
from service.publish.sinks import Announcement, Occasion
from service.records.record import document
from service.records.trust import HorizonTrust, Trust
from service.web.app import create_app
from service.web.site import Backend

SITE = "home"
STANDING = ["forecast", "volatility", "gate", "trust", "status"]


class Listener(Client):
    """One connection to a stream, read as bytes and parsed into events."""

    text, rest = "", b""

    async def until(self, heard):
        """Read until `heard` is true."""
        async with asyncio.timeout(PATIENCE):
            while not heard():
                chunk = await self.reader.read(65536)
                assert chunk, f"ended after {self.text}"
                self.text += chunk.decode()

    async def events(self, count):
        """Read until `count` events have come; (event, id, data) of every one of them."""
        await self.until(lambda: len(self.parsed()) >= count)
        return self.parsed()

    async def heard(self, stamp):
        """Read until the status of the sample at `stamp` has come; how many events came before, which are forgotten."""
        await self.until(lambda: f"id: {stamp}" in self.text.rpartition("event: status")[2])
        news, self.text = self.text, ""
        return news.count("event: ")

    def parsed(self):
        events = []
        for block in self.text.replace("\r\n", "\n").split("\n\n"):
            lines = block.split("\n")
            fields = dict(line.split(": ", 1) for line in lines if line.startswith(("event: ", "id: ", "data: ")))
            if "data" in fields:
                events.append((fields["event"], fields.get("id"), json.loads(fields["data"])))
        return events


class Site:
    """A server with one zone, whose updates tests announce."""

    def __init__(self, server, streams, zone, app):
        self.server, self.streams, self.zone, self.app, self.clients = server, streams, zone, app, []

    @property
    def open(self):
        return self.app.state.limiter.open("streams")

    async def connect(self, headers="", deaf=False, query=""):
        # A reader with a tiny limit stops reading from its socket until it is asked to.
        client = await Listener.to(self.server, limit=16 if deaf else 2**16)
        if deaf:
            client.writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        await client.send(f"GET /zones/living/stream{query} HTTP/1.1\r\nHost: localhost\r\n{headers}\r\n".encode())
        self.clients.append(client)
        return client

    async def announce(self, step):
        update = make_update(step, self.zone.network)
        self.zone.updates.append(update)
        # As the zones do, from another thread.
        await asyncio.to_thread(self.streams.publish, announced("living", update, self.zone.now().status, site=SITE))
        return update


@asynccontextmanager
async def opened(limits=None, zone=None):
    streams, http = Streams(), config(limits=limits or {})
    zone = zone or running("living")
    app = create_app(SITE, {"living": zone}, CollectorRegistry(), backend=Backend(streams=streams), http=http)
    async with serving(app, http) as server:
        site = Site(server, streams, zone, app)
        yield site
        streams.end()
    for client in site.clients:
        client.rest = b"" if client.writer.is_closing() else await client.reader.read(2**20)
        await client.close()


def stamp(step):
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(START + step * PERIOD))


async def test_what_stands_comes_at_once_and_then_what_is_issued():
    async with opened() as server:
        client = await server.connect(headers="Accept-Encoding: gzip\r\n")
        first = await client.events(5)
        assert [kind for kind, _, _ in first] == STANDING
        assert {id for _, id, _ in first} == {stamp(2)}
        update = await server.announce(3)
        *_, forecast, volatility, gate, status = await client.events(9)
        kinds = (ForecastPayload, VolatilityPayload, GatePayload)
        for (_, id, data), kind in zip((forecast, volatility, gate), kinds, strict=True):
            assert id == stamp(3)
            assert data == json.loads(document(kind.of(update), SITE, "living"))
        assert (status[0], status[2]["samples"]) == ("status", 4)
        head = client.text.split("\r\n\r\n")[0].lower()
        assert "200 ok" in head
        assert "content-type: text/event-stream" in head
        assert "content-encoding" not in head, "compression would hold events back"
        assert "retry: 3000" in client.text


async def test_a_client_that_comes_back_is_given_the_rows_it_missed():
    async with opened() as server:
        for last in (stamp(0), stamp(2), "nonsense", stamp(0)[:-1], "9999-12-31T23:59:59-14:00"):
            rows = [stamp(1), stamp(2)] if last == stamp(0) else []
            client = await server.connect(headers=f"Last-Event-ID: {last}\r\n")
            events = await client.events(6 if rows else 5)
            history = [data for kind, _, data in events if kind == "history"]
            assert [row["time"] for data in history for row in data["rows"]] == rows
            assert [kind for kind, _, _ in events][-5:] == STANDING


async def test_a_silent_zone_sends_comments(monkeypatch):
    monkeypatch.setattr(service.publish.events, "KEEP_ALIVE", 0.02)
    async with opened() as server:
        client = await server.connect()
        await client.until(lambda: client.text.count(": ping") >= 3)
        assert len(client.parsed()) == 5


async def test_newer_events_take_the_place_of_those_that_were_not_read():
    stream = Stream()
    reading = stream.read()
    assert (await anext(reading)).startswith(b"retry")
    stream.put([Event("forecast", b"f1"), Event("gate", b"g1")])
    assert stream.put([Event("forecast", b"f2")]) == 1
    assert await anext(reading) == b"g1f2"
    stream.put([Event("gate", b"g2")])
    stream.end()
    assert [data async for data in reading] == [b"g2"]


async def test_two_hundred_streams_all_hear_every_sample_and_none_is_left_over():
    async with opened({"streams_per_client": 200, "streams": 200}) as server:
        clients = await asyncio.gather(*(server.connect() for _ in range(200)))
        await asyncio.gather(*(client.events(5) for client in clients))
        assert server.open == 200
        for step in (3, 4, 5):
            await server.announce(step)
            heard = await asyncio.gather(*(client.events(4 * (step - 1)) for client in clients))
            assert {events[-1][1] for events in heard} == {stamp(step)}
        for client in clients:
            client.writer.close()
        await until(lambda: server.open == 0)
        assert not server.streams._open


async def test_a_client_that_never_reads_holds_four_events_and_is_cut_off_or_left_at_a_stop():
    for cut_off in (True, False):
        async with opened({"send_timeout": 1.0} if cut_off else {}) as server:
            stuck, well = await server.connect(deaf=True), await server.connect()
            await well.heard(stamp(2))
            step = 2
            # Until the buffers between the two are full; from then on nothing but the newest is kept for it.
            while server.streams.overtaken < 40:
                step += 1
                await server.announce(step)
                assert await well.heard(stamp(step)) == 4, "the others miss nothing"
            assert server.open == 2
            waiting = [stream._pending for stream in server.streams._open["living"]]
            assert sum(len(data) for pending in waiting for data in pending.values()) < 10_000
            if cut_off:
                await until(lambda: server.open == 1)
                assert not stuck.writer.is_closing(), "it was not the client who left"
        assert well.rest.endswith(b"0\r\n\r\n"), "the answer was completed"
        assert not stuck.rest.endswith(b"0\r\n\r\n")


async def test_sentences_are_in_the_language_that_is_asked_for():
    zone = running("living")
    zone.trusted = Trust(START, (HorizonTrust(300, "doubtful", "do not rely on the model yet", START),))
    async with opened(zone=zone) as server:
        german, english = await server.connect(query="?language=de"), await server.connect()
        begun = [{kind: data for kind, _, data in await client.events(5)}["trust"] for client in (german, english)]
        reasons = [trust["horizons"][0]["reason"] for trust in begun]
        assert reasons == ["noch nicht auf das Modell verlassen", "do not rely on the model yet"]
        zone.state, zone.reason = "stalled", "its recording has come to an end"
        await asyncio.to_thread(server.streams.publish, Announcement(SITE, "living", zone.now(), Occasion.STATUS))
        for client, told in ((german, "die Aufzeichnung ist zu Ende"), (english, "its recording has come to an end")):
            assert (await client.events(6))[-1][2]["reason"] == told


async def test_a_client_that_comes_later_hears_the_hours_ahead_at_once():
    async with opened() as server:
        heard = Announced()
        await LookingAhead(SITE, {"living": server.zone}, [heard, server.streams]).attend("living")
        client = await server.connect()
        first = {kind: data for kind, _, data in await client.events(6)}
        assert first["ahead"] == json.loads(heard.told[0].payload("ahead"))
        assert server.streams.overtaken == 0
