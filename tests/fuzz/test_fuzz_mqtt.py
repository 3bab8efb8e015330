"""MQTT: whatever a broker sends is a message or the end of the connection, and whatever a message holds is a reading, a
fault, or nothing; a topic is sound or a sentence."""

import socket
from contextlib import suppress
from typing import Any

import paho.mqtt.client as paho
from fuzz.fuzzing import raw
from fuzz.messages import NOW, become_readings

from adapters.messages.inbox import LONGEST_PAYLOAD, Incoming
from adapters.messages.subscribed import described
from adapters.mqtt.broker import topic_problem
from adapters.mqtt.client import _incoming

FORMS: list[dict[str, Any]] = [
    {},
    {"format": "json", "value": "/temperature", "time": "/time", "quality": "/quality"},
    {"format": "senml", "record": "T"},
]
CLIENT = paho.Client(paho.CallbackAPIVersion.VERSION2)
DOCUMENT = b'{"temperature": 21.5, "time": "2026-02-25T06:13:10Z", "quality": "good", "linkquality": 87}'


def published(topic: str, payload: bytes, retained: bool) -> None:
    """To readings, and to what a person who looks for another topic is told."""
    become_readings(payload, FORMS, retained=retained)
    if topic_problem(topic) is None and topic.isprintable():
        fits = payload if len(payload) <= LONGEST_PAYLOAD else None
        assert described(Incoming(topic, fits, len(payload), None, NOW, retained)).isprintable()


@raw(b"21.5", b"", DOCUMENT, b'[{"n": "T", "v": 21.5}]', b"9" * 70_000, examples=200)
def test_mqtt_message(data: bytes) -> None:
    for retained in (False, True):
        published("home/T", data, retained)


@raw(b"home/living/T", b"home/+", b"#", b"", b"\x00", b"\xed\xa0\x80", b"a" * 70_000, examples=200)
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


@raw(CONNACK + PUBLISHED, CONNACK + KEPT, PUBLISHED[:9], packet(0x90, b"\x00\x01\x00\x00"), examples=150)
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
    # Whatever the library raises ends the connection; see `_library`.
    with ours, suppress(Exception):
        for _ in range(len(data) + 2):
            if client.loop_read() != paho.MQTT_ERR_SUCCESS:
                break
    client._sock = None
    for incoming in came:
        published(incoming.key, incoming.payload or b"", incoming.retained)
