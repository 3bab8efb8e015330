"""MQTT: whatever a broker sends is a message or the end of the connection, and whatever a message holds is a reading, a
fault, or nothing; a topic is sound or a sentence."""

from __future__ import annotations

import json
import math
import socket
from contextlib import suppress

import paho.mqtt.client as paho
from fuzz.fuzzing import raw, structured
from hypothesis import strategies as st

from adapters.edge import Edge
from adapters.messages.inbox import LONGEST_PAYLOAD, Incoming
from adapters.messages.points import Channels, Dating, MessageChannel, probed
from adapters.mqtt.broker import topic_problem
from adapters.mqtt.client import _incoming
from adapters.mqtt.source import TIMES, _described
from adapters.payload.payload import PayloadFormat
from adapters.reading import Quality

NOW = 1_772_000_000.0
FORMS = (
    PayloadFormat(),
    PayloadFormat("json", ("temperature",), ("time",), ("quality",)),
    PayloadFormat("senml", record="T"),
)
CLIENT = paho.Client(paho.CallbackAPIVersion.VERSION2)
DOCUMENT = b'{"temperature": 21.5, "time": "2026-02-25T06:13:10Z", "quality": "good", "linkquality": 87}'


def become_readings(topic: str, payload: bytes, retained: bool) -> None:
    """Through dating, stuck watch and edge to readings, and to what a person is shown; twice, as after a reconnect."""
    fits = payload if len(payload) <= LONGEST_PAYLOAD else None
    incoming = Incoming(topic, fits, len(payload), None, NOW, retained)
    listed = [MessageChannel(f"z/{k}", topic, form, Edge(valid=(-60.0, 80.0)), 10.0) for k, form in enumerate(FORMS)]
    listed.append(MessageChannel("z/meter", topic, edge=Edge(counter=True, rollover=65536.0)))
    channels = Channels(listed, Dating(TIMES), 900.0, "topic")
    for _ in range(2):
        channels.start_again()
        for reading in channels.readings(topic, [incoming]):
            assert (reading.fault is None) == (reading.quality is not Quality.BAD)
            assert reading.fault is not None or (math.isfinite(reading.value) and 0 <= reading.time <= NOW + 10)
            # A retained value whose age nobody knows is never good.
            assert not retained or reading.time != NOW or reading.quality is not Quality.GOOD
    for channel in listed:
        shown = probed(channel, Dating(TIMES), [incoming], "nothing came")
        assert "".join((shown.raw, shown.verdict, *shown.hints)).isprintable()
    if topic_problem(topic) is None and topic.isprintable():
        assert _described(incoming).isprintable()


@raw(b"21.5", b"", DOCUMENT, b'[{"n": "T", "v": 21.5}]', b"9" * 70_000, share=8, examples=200)
def test_mqtt_message(data: bytes) -> None:
    for retained in (False, True):
        become_readings("home/T", data, retained)


@structured(
    share=3,
    examples=80,
    document=st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=4),
        max_leaves=12,
    ),
    retained=st.booleans(),
)
def test_mqtt_document(document: object, retained: bool) -> None:
    become_readings("home/T", json.dumps(document).encode(), retained)


@raw(b"home/living/T", b"home/+", b"#", b"", b"\x00", b"\xed\xa0\x80", b"a" * 70_000, share=3, examples=200)
def test_mqtt_topic(data: bytes) -> None:
    topic = data.decode("utf-8", "surrogateescape")
    problem = topic_problem(topic)
    if problem is None:
        assert topic
        # What the library would refuse is refused before.
        assert CLIENT.publish(topic, b"").rc == paho.MQTT_ERR_NO_CONN
    else:
        assert "\n" not in problem


def packet(kind: int, body: bytes) -> bytes:
    length, written = len(body), b""
    while True:
        length, digit = divmod(length, 128)
        written += bytes([digit | (0x80 if length else 0)])
        if not length:
            return bytes([kind]) + written + body


CONNACK = packet(0x20, b"\x00\x00\x00")
PUBLISHED = packet(0x30, b"\x00\x06home/T\x0021.5")
KEPT = packet(0x33, b"\x00\x06home/T\x00\x01\x00" + DOCUMENT)


@raw(CONNACK + PUBLISHED, CONNACK + KEPT, PUBLISHED[:9], packet(0x90, b"\x00\x01\x00\x00"), share=4, examples=150)
def test_mqtt_wire(data: bytes) -> None:
    """Bytes from a broker that follows no specification, through the client library to our messages."""
    came: list[Incoming] = []
    ours, theirs = socket.socketpair()
    client = paho.Client(paho.CallbackAPIVersion.VERSION2, "fuzz", protocol=paho.MQTTv5, reconnect_on_failure=False)
    client.on_message = lambda _client, _data, message: came.append(_incoming(message))
    ours.setblocking(False)
    client._sock = ours
    theirs.sendall(data)
    theirs.close()
    # Whatever the library raises ends the connection; see `Client.lost`.
    with ours, suppress(Exception):
        for _ in range(len(data) + 2):
            if client.loop_read() != paho.MQTT_ERR_SUCCESS:
                break
    client._sock = None
    for incoming in came:
        become_readings(incoming.key, incoming.payload or b"", incoming.retained)
