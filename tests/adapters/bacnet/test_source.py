"""The BACnet source against bacpypes3's own server on loopback: what it reads, and what it survives."""

import asyncio
import logging
import math
import socket
import time
from contextlib import aclosing

import pytest

pytest.importorskip("bacpypes3", reason="bacpypes3 is not installed")

from bacpypes3.pdu import IPv4Address
from support.bacnet_plant import Bbmd, Peer, free_udp_port, one_device, serving
from support.sources import becomes, bound, collect, exhaust, source_table, values
from support.waiting import PATIENCE, until

import adapters.bacnet.session
import adapters.bacnet.source
from adapters.bacnet.client import Device, Found, TooLong
from adapters.bacnet.scan import scan
from adapters.bacnet.stack import Datagrams
from adapters.errors import SourceConfigError, SourceUnavailable
from adapters.reading import Fault, Quality
from adapters.scanning import Scan


def channel(name="T", object="analog-input,1", device=1201, **keys):
    table = source_table("bacnet", interface="127.0.0.1")
    return bound(table, f"z/{name}", **{"unit": "degC", "cov": False} | keys, object=object, device=device)


def source(port, channels, lifetime=300.0, **keys):
    quick = {"interface": "127.0.0.1/8", "port": port, "timeout": 2.0, "retries": 0, "poll": 0.05}
    return source_table("bacnet", **quick | keys).model_copy(update={"lifetime": lifetime}).build("bms", channels)


async def test_present_values_are_polled_and_converted():
    port, peer = one_device(None)
    peer.add("analog-input,1", 21.5)
    peer.add("analog-value,7", 72.5, "degreesFahrenheit")
    peer.add("analog-input,2", 1.25, "kilowatts")
    peer.add("binary-input,1", "active")
    channels = [
        channel("air", "analog-input,1"),
        channel("fahrenheit", "analog-value,7", unit="degF", to="degC"),
        channel("power", "analog-input,2", unit="kW", to="W"),
        channel("relay", "binary-input,1", unit="W", scale=1500.0),
    ]
    async with serving(peer):
        before = time.time()
        batches = await collect(source(port, channels), lambda got: len(got) >= 3)
        for batch in batches:
            assert all(before <= reading.time <= batch.now <= time.time() for reading in batch.readings)
        found, asked = values(batches), peer.asked
    assert found == {"z/air": 21.5, "z/fahrenheit": pytest.approx(22.5), "z/power": 1250.0, "z/relay": 1500.0}
    assert asked.count("ReadPropertyMultipleRequest") >= 4, "the units once, then the values of every poll at once"
    assert asked.count("ReadPropertyRequest") == 2, "what the device can do"


@pytest.mark.parametrize(
    ("longest", "without", "expected"),
    [
        # Units and values, five objects at once.
        (206, set(), {"ReadPropertyMultipleRequest": 2 * 3, "ReadPropertyRequest": 2}),
        (1024, {"ReadPropertyMultipleRequest"}, {"ReadPropertyRequest": 2 + 3 * 12}),
    ],
)
async def test_answers_stay_within_what_the_device_can_send(longest, without, expected):
    port, peer = one_device(None, longest=longest)
    peer.without, numbers = without, range(1, 13)
    for number in numbers:
        peer.add(f"analog-input,{number}", float(number))
    async with serving(peer):
        batches = await collect(source(port, [channel(f"c{number}", f"analog-input,{number}") for number in numbers]))
    assert values(batches) == {f"z/c{number}": float(number) for number in numbers}
    assert {name: peer.asked.count(name) for name in expected} == expected


async def test_a_device_that_denies_what_it_offers_is_asked_one_by_one():
    port, peer = one_device()
    peer.add("analog-input,2", 5.0)
    (services := peer.get_services_supported())[14] = 1
    async with serving(peer):
        peer.without = {"ReadPropertyMultipleRequest"}
        peer.get_services_supported = lambda: services
        found = values(await collect(source(port, [channel(), channel("two", "analog-input,2")])))
    assert found == {"z/T": 21.5, "z/two": 5.0}


async def test_a_subscription_brings_changes_and_polling_stops(monkeypatch):
    monkeypatch.setattr(adapters.bacnet.session, "CONFIRM", 3600.0)
    port, peer = one_device(None)
    air = peer.add(value=20.0)
    async with serving(peer), aclosing(source(port, [channel(stuck_after=3600.0, cov=True)]).batches(None)) as stream:
        while "SubscribeCOVRequest" not in peer.asked:
            await anext(stream)
        for _ in range(3):
            await anext(stream)
        read = peer.asked.count("ReadPropertyMultipleRequest")
        air.presentValue = 23.5
        await becomes(stream, {"z/T": 23.5})
        air.statusFlags = [0, 1, 0, 0]
        await becomes(stream, {"z/T": Fault.REPORTED_BAD})
        assert peer.asked.count("ReadPropertyMultipleRequest") == read, "it is told, and need not ask"
        assert peer.asked.count("SubscribeCOVRequest") == 1
        before = time.time()
        batch = await anext(stream)
        assert before - 1 < batch.readings[0].time <= time.time(), "what holds is said again in every poll"
        peer.silent, silent, after = True, time.time(), []
        with pytest.raises(SourceUnavailable, match="no answer from"):
            await exhaust(stream, after)
        late = [one for batch in after for one in batch.readings if one.time > silent + 1.0]
        assert late == [], "what a dead device told last is measured no more"


async def test_what_is_subscribed_to_is_confirmed_and_renewed(monkeypatch):
    monkeypatch.setattr(adapters.bacnet.session, "CONFIRM", 0.1)
    port, peer = one_device(None)
    air = peer.add(value=20.0, covIncrement=5.0)
    async with serving(peer), aclosing(source(port, [channel(cov=True)], lifetime=0.2).batches(None)) as stream:
        while peer.asked.count("SubscribeCOVRequest") < 3:
            await anext(stream)
        # Too little to be told of.
        air.presentValue = 21.0
        await becomes(stream, {"z/T": 21.0})


async def test_what_is_not_offered_is_polled(caplog):
    caplog.set_level(logging.INFO)
    port, peer = one_device(None)
    offered, refused = peer.add("analog-input,1", 1.0), peer.add("analog-input,2", 2.0)
    peer.refused.add(("analog-input", 2))
    unwanted = peer.add("analog-input,3", 3.0)
    channels = [
        channel("a", "analog-input,1", cov=True),
        channel("b", "analog-input,2", cov=True),
        channel("c", "analog-input,3"),
    ]
    async with serving(peer), aclosing(source(port, channels).batches(None)) as stream:
        while peer.asked.count("SubscribeCOVRequest") < 2:
            await anext(stream)
        for one, value in ((offered, 11.0), (refused, 12.0), (unwanted, 13.0)):
            one.presentValue = value
        await becomes(stream, {"z/a": 11.0, "z/b": 12.0, "z/c": 13.0})
        assert peer.asked.count("SubscribeCOVRequest") == 2
    assert caplog.text.count("offers no subscription to analog-input,2 (resources error no-space-to-add") == 1


async def test_values_that_cannot_be_used():
    port, peer = one_device(None)
    peer.add("analog-input,1", 71.5, "degreesFahrenheit")
    peer.add("analog-input,2", math.nan)
    peer.add("analog-input,3", 200.0)
    peer.add("analog-input,4", reliability="noSensor")
    peer.add("analog-input,5", outOfService=True)
    peer.add("analog-input,6", overridden=True)
    expected = {
        "sensor": ("analog-input,4", Fault.REPORTED_BAD),
        "service": ("analog-input,5", Fault.REPORTED_BAD),
        "overridden": ("analog-input,6", 21.5),
        "unit": ("analog-input,1", Fault.WRONG_UNIT),
        "nan": ("analog-input,2", Fault.NOT_FINITE),
        "range": ("analog-input,3", Fault.OUT_OF_RANGE),
        "missing": ("analog-input,9", Fault.REFUSED_BY_DEVICE),
    }
    channels = [channel(name, object) for name, (object, _) in expected.items()]
    ignored = channel("ignored", "analog-input,1", compare_units=False)
    async with serving(peer):
        batches = await collect(source(port, [*channels, ignored]), bool)
    assert [one.channel for one in batches[0].readings if one.quality is Quality.UNCERTAIN] == ["z/overridden"]
    assert values(batches) == {f"z/{name}": value for name, (_, value) in expected.items()} | {"z/ignored": 71.5}


async def test_a_refused_object_loses_its_channel_only_and_is_asked_for_again(caplog):
    caplog.set_level(logging.INFO)
    port, peer = one_device()
    bms = source(port, [channel(), channel("two", "analog-input,2")])
    async with serving(peer), aclosing(bms.batches(None)) as stream:
        assert values([await anext(stream)]) == {"z/T": 21.5, "z/two": Fault.REFUSED_BY_DEVICE}
        for _ in range(4):
            (reading,) = (await anext(stream)).readings
            assert reading.channel == "z/T"
        peer.add("analog-input,2", 5.0)
        # The time to ask again has come.
        bms._sessions[1201].rebound()
        await becomes(stream, {"z/T": 21.5, "z/two": 5.0})
    assert caplog.text.count("refuses z/two (device 1201 analog-input,2): object error unknown-object") == 1
    assert caplog.text.count("the device gives z/two (device 1201 analog-input,2) again") == 1


async def test_a_silent_device_does_not_hold_up_the_others(caplog):
    caplog.set_level(logging.INFO)
    port = free_udp_port()
    one, other = Peer(1201, port, 1), Peer(1202, port, 2)
    one.add(value=1.0)
    other.add(value=2.0)
    bms = source(port, [channel("one"), channel("other", device=1202)], timeout=0.3)
    async with serving(one, other), asyncio.timeout(PATIENCE), aclosing(bms.batches(None)) as stream:
        await becomes(stream, {"z/one": 1.0, "z/other": 2.0})
        other.silent = True
        while "device 1202 is silent" not in caplog.text:
            await anext(stream)
        assert values([await anext(stream)]) == {"z/one": 1.0}
        other.silent = False
        await becomes(stream, {"z/other": 2.0})
    assert "device 1202 answers again" in caplog.text


async def test_when_every_device_is_silent_the_source_is_not_there():
    port = free_udp_port()
    bms = source(port, [channel(), channel("x", device=1299)], timeout=0.2)
    with pytest.raises(SourceUnavailable, match=r"sources\.bms: no device 12\d\d answers within 0\.2 s, and 1 other;"):
        await collect(bms)
    peer = Peer(1201, port)
    peer.add()
    async with serving(peer):
        assert values(await collect(bms, bool)) == {"z/T": 21.5}, "the next attempt is a new one"
    elsewhere = source(port, [channel(at=f"127.0.7.9:{port}")], timeout=0.2)
    with pytest.raises(SourceUnavailable, match=rf"no answer from 127\.0\.7\.9:{port} within 0\.2 s"):
        await collect(elsewhere)


async def test_the_address_of_a_device_can_be_given_and_is_checked():
    port, peer = one_device()
    async with serving(peer):
        bms = source(port, [channel(at=peer.where)], interface="127.0.0.1")
        assert values(await collect(bms, bool)) == {"z/T": 21.5}
        assert "WhoIsRequest" not in peer.asked
        wrong = source(port, [channel(device=77, at=peer.where)])
        with pytest.raises(SourceUnavailable, match=r"is not device 77: object error unknown-object"):
            await collect(wrong)


async def test_channels_change_while_it_is_at_work():
    port = free_udp_port()
    one, other = Peer(1201, port, 1), Peer(1202, port, 2)
    one.add(value=1.0)
    one.add("analog-input,2", 3.0)
    other.add(value=2.0)
    bms = source(port, [channel("one")])
    async with serving(one, other), asyncio.timeout(PATIENCE), aclosing(bms.batches(None)) as stream:
        assert values([await anext(stream)]) == {"z/one": 1.0}
        bms.rebind([channel("other", device=1202), channel("more", "analog-input,2")])
        await becomes(stream, {"z/other": 2.0, "z/more": 3.0})
        bms.rebind([channel("other", device=1202)])
        while "z/more" in values([await anext(stream)]):
            pass
        await anext(stream)
        asked = len(one.asked)
        for _ in range(5):
            assert values([await anext(stream)]) == {"z/other": 2.0}
        assert len(one.asked) == asked, "a device without channels is left alone"
        bms.rebind([channel("other", device=1202, at=one.where)])
        with pytest.raises(SourceUnavailable, match="is not device 1202"):
            await exhaust(stream)


async def test_what_is_malformed_is_counted_and_harms_nothing(caplog):
    port, peer = one_device()
    bms = source(port, [channel()])
    async with serving(peer), aclosing(bms.batches(None)) as stream:
        await anext(stream)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.bind(("127.0.7.99", 0))
            for frame in (
                b"",
                b"hello",
                b"\x81\x0a\x00\xff\x01",
                b"\x81\x0a\x00\x06\x01\x00",
                b"\x81\x77\x00\x04",
                # An I-Am and a notification whose parameters end too soon.
                b"\x81\x0a\x00\x09\x01\x00\x10\x00\xc4",
                b"\x81\x0a\x00\x0a\x01\x00\x10\x02\x09\x01",
            ):
                for _ in range(20):
                    stranger.sendto(frame, ("127.0.0.1", port))
            await until(lambda: sum(bms.malformed.values()) >= 100)
        for _ in range(3):
            assert values([await anext(stream)]) == {"z/T": 21.5}
        malformed = bms.malformed
    assert malformed.keys() == {"not_bacnet", "frame", "apdu"}
    assert malformed["apdu"] == 40
    for kind in malformed:
        assert caplog.text.count(f"something came that cannot be used ({kind})") == 1


async def test_a_flood_is_bounded_and_harms_nothing(caplog):
    port, peer = one_device()
    bms = source(port, [channel()], retries=3)
    # Who-Is, 20,000 of them as fast as they can be sent.
    frame = bytes.fromhex("810a000c0120ffff00ff1008")
    async with serving(peer), aclosing(bms.batches(None)) as stream:
        await anext(stream)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            for _ in range(20):
                await asyncio.to_thread(lambda: [stranger.sendto(frame, ("127.0.0.1", port)) for _ in range(1000)])
                assert len(bms._link._application.datagrams._waiting) <= 200 + 2
        assert bms.malformed.keys() <= {"overrun"}
        async with asyncio.timeout(PATIENCE):
            for _ in range(5):
                assert values([await anext(stream)]) == {"z/T": 21.5}


async def test_addresses_are_forgotten_once_what_they_sent_is_taken():
    datagrams = Datagrams(IPv4Address(f"127.0.0.1:{free_udp_port()}"), lambda kind: None)
    await datagrams.open(broadcasts=False, beside=False)
    for number in range(1000):
        datagrams.received(b"nothing", (f"10.0.{number // 256}.{number % 256}", 47808), None)
    await until(lambda: not datagrams._waiting)
    assert not datagrams._waiting_from, "a flood may come from ever new ones"
    await datagrams.close()


async def test_as_a_foreign_device_it_finds_devices_through_the_bbmd():
    # Devices and BBMD on one port, the source on another: their broadcasts do not reach it.
    port, peer = one_device()
    bbmd = Bbmd(port)
    bms = source(free_udp_port(), [channel()], interface="127.0.0.1", bbmd=bbmd.where, ttl=30.0)
    async with serving(peer):
        await bbmd.datagrams.open(broadcasts=True, beside=False)
        assert values(await collect(bms, bool)) == {"z/T": 21.5}
        (row,) = (await bms.scan(Scan(seconds=0.5))).rows[1:]
        assert row[2:5] == ("analog-input,1", "name of analog-input,1", "21.5")
        await bbmd.close()
        none = source(free_udp_port(), [channel()], interface="127.0.0.1", bbmd=peer.where)
        with pytest.raises(SourceUnavailable, match="refuses to register foreign devices"):
            await collect(none)
    alone = source(port, [channel()], interface="127.0.0.1", bbmd=f"127.0.7.201:{port}", timeout=0.2)
    with pytest.raises(SourceUnavailable, match=r"the BBMD 127\.0\.7\.201:\d+ does not answer"):
        await collect(alone)


async def test_probe_shows_what_each_channel_brings():
    port, peer = one_device()
    peer.add("analog-input,2", 71.0, "degreesFahrenheit")
    peer.add("analog-input,3", 12.0, "kilowattHours")
    peer.add("analog-input,4", 99.0)
    peer.add("analog-input,6", 1.8, covIncrement=0.5)
    peer.add("analog-input,5", 20.0, reliability="noSensor")
    channels = [
        channel(),
        channel("F", "analog-input,2"),
        channel("meter", "analog-input,3", unit="kWh", to="W"),
        channel("hot", "analog-input,4"),
        channel("broken", "analog-input,5"),
        channel("cold", "analog-input,6", usual=(5.0, 40.0), cov=True),
        channel("none", "analog-input,9"),
        channel("away", device=1299),
    ]
    async with serving(peer):
        found = await source(port, channels, timeout=0.5).probe(0.3)
    probes = {probe.channel.removeprefix("z/"): probe for probe in found}
    assert (probes["T"].value, probes["T"].raw, probes["T"].verdict) == (21.5, "21.5 degC", "good")
    assert probes["T"].hints == ('the device calls it "name of analog-input,1"',)
    assert probes["F"].verdict == ('wrong unit: the device states degF; write unit = "degF", or compare_units = false')
    assert probes["meter"].hints[0] == "the counter stands at 12"
    assert probes["hot"].verdict == "implausible: not within -60 to 80"
    assert probes["cold"].verdict == "doubtful: usually 5 to 40 here; if it is right, give valid"
    assert probes["cold"].hints[1].startswith("its COV increment is 0.5: a subscription shows no smaller change")
    assert probes["broken"].verdict == "reported bad: its status is fault"
    assert probes["none"].verdict.startswith("the device refuses it: object error unknown-object; check object")
    assert probes["away"].verdict.startswith("no device 1299 answers within 0.5 s; check device")
    assert probes["away"].hints[0].startswith("devices that answer: 1201 (127.0.7.1:")


async def test_probe_works_beside_a_daemon_that_has_the_port():
    port, peer = one_device()
    daemon, beside = source(port, [channel()]), source(port, [channel()])
    async with serving(peer), aclosing(daemon.batches(None)) as stream:
        await anext(stream)
        (probe,) = await beside.probe(1.0)
        assert probe.verdict == "good"
        assert values([await anext(stream)]) == {"z/T": 21.5}
        with pytest.raises(SourceUnavailable, match=r"cannot be used \(Address already in use\); check that interface"):
            await collect(source(port, [channel()]))


async def test_scan_lists_devices_and_their_numbers():
    port = free_udp_port()
    one, other, empty = Peer(1201, port, 1), Peer(1300, port, 2, longest=206), Peer(1400, port, 3)
    one.add()
    one.add("binary-input,4", "active")
    for number in range(1, 31):
        other.add(f"analog-value,{number}", float(number), "kilowatts")
    async with serving(one, other, empty):
        bms = source(port, [])
        everything, some = await bms.scan(Scan(seconds=0.5)), await bms.scan(Scan((1202, 1399), seconds=0.5))
    rows = [dict(zip(everything.rows[0], row, strict=True)) for row in everything.rows[1:]]
    assert [row["device"] for row in rows] == ["1201"] * 2 + ["1300"] * 30
    shown = ("object", "name", "value", "unit", "status")
    assert [rows[0][one] for one in shown] == ["analog-input,1", "name of analog-input,1", "21.5", "degC", "ok"]
    assert [rows[-1][one] for one in ("object", "value", "unit")] == ["analog-value,30", "30", "kW"]
    assert [remark[:12] for remark in everything.remarks] == ["device 1400 "]
    assert {row[0] for row in some.rows[1:]} == {"1300"}
    with pytest.raises(SourceConfigError, match="a scan asks everybody: give interface its prefix"):
        await source(free_udp_port(), [], interface="127.0.0.1").scan(Scan())


async def test_scan_goes_on_after_a_device_that_does_not_say_how_many_objects_it_has():
    class Odd:
        async def who_is(self, *_):
            return [Found(1201, "there")]

        async def find(self, *_):
            return Device(1201, "there")

        async def read_list(self, *_):
            raise TooLong("abort 4")

        async def read_one(self, *_):
            return 1.5

    found = await scan(Odd(), Scan(seconds=0.5), broadcasts=True)
    assert found.remarks == ["device 1201: it does not say how many objects it has"]


def test_without_the_library_or_a_way_to_find_devices_check_says_so(monkeypatch):
    assert source(47808, [channel()], interface="192.0.2.1").check() == [
        "sources.bms: nobody can be asked where device 1201 is: give interface its prefix, such as interface = "
        '"192.0.2.1/24", or give bbmd, or say at which address each device is'
    ]
    assert source(47808, [channel(at="192.0.2.7")], interface="192.0.2.1").check() == []
    monkeypatch.setattr(adapters.bacnet.source, "find_spec", lambda name: None)
    assert source(47808, [channel()]).check() == [
        "sources.bms: BACnet needs bacpypes3; install it with: pip install 'thermogate[bacnet]'"
    ]
    with pytest.raises(SourceConfigError, match="needs bacpypes3"):
        asyncio.run(source(47808, [channel()]).probe(1.0))
