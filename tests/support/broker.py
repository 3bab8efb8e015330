"""The other side of MQTT: mosquitto as a process of its own on loopback, and clients that publish and listen there."""

import subprocess
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import paho.mqtt.client as paho
from support.processes import Program, free_port, listens, program
from support.waiting import PATIENCE


class Mosquitto:
    """A broker on a free port that can be stopped and started again."""

    def __init__(self, folder: Path, *lines: str, listener: Sequence[str] = ()) -> None:
        """`lines` are settings of the broker, and `listener` of its listener."""
        self.port = free_port()
        self._config = folder / "mosquitto.conf"
        # As root it would become a user who cannot read the folder.
        own = ["user root", f"listener {self.port} 127.0.0.1"]
        settings = [*(lines or ("allow_anonymous true",)), *own, *listener]
        self._config.write_text("\n".join(settings) + "\n", encoding="utf-8")
        self._running: Program | None = None

    def start(self) -> None:
        command = [program("mosquitto", "mosquitto"), "-c", self._config]
        self._running = Program(command, self._config.with_suffix(".log"))
        self._running.wait_for(lambda: listens(self.port))

    def stop(self) -> None:
        if self._running is not None:
            self._running.kill()
            self._running = None


@contextmanager
def broker(folder: Path, *lines: str, listener: Sequence[str] = ()) -> Iterator[Mosquitto]:
    running = Mosquitto(folder, *lines, listener=listener)
    running.start()
    try:
        yield running
    finally:
        running.stop()


def flood(port: int, topic: str, payloads: Iterable[str]) -> None:
    """Publish as fast as mosquitto's own client can."""
    lines = "".join(f"{payload}\n" for payload in payloads)
    command = [program("mosquitto_pub", "mosquitto-clients"), "-h", "127.0.0.1", "-p", str(port), "-t", topic, "-l"]
    subprocess.run(command, input=lines, text=True, check=True, timeout=PATIENCE)


class Party:
    """A client that publishes, and keeps what comes on the topics it listens to."""

    def __init__(self, port: int, *topics: str, connect: Callable[[paho.Client], object] = lambda client: None) -> None:
        """`connect` may give it user, password and TLS."""
        self.came: list[tuple[str, bytes, bool]] = []
        self._topics = topics
        self._client = paho.Client(paho.CallbackAPIVersion.VERSION2)
        self._client.reconnect_delay_set(0.1, 0.5)
        # 10,000 messages a second must not wait for each other.
        self._client.max_queued_messages_set(0)
        self._client.on_connect = self._connected
        self._client.on_message = self._message
        connect(self._client)
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()

    def _connected(self, client: paho.Client, *_: Any) -> None:
        for topic in self._topics:
            client.subscribe(topic, 1)

    def _message(self, client: paho.Client, data: object, message: paho.MQTTMessage) -> None:
        self.came.append((message.topic, message.payload, bool(message.retain)))

    def put(self, topic: str, payload: str | bytes, retain: bool = False, qos: int = 0) -> None:
        """Publish; with `qos` 1 it is at the broker when this returns."""
        info = self._client.publish(topic, payload, qos=qos, retain=retain)
        if qos:
            info.wait_for_publish(PATIENCE)

    def newest(self) -> dict[str, bytes]:
        """What came last on each topic."""
        return {topic: payload for topic, payload, _ in tuple(self.came)}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.disconnect()
        self._client.loop_stop()
        # Closes the pair of sockets that woke its thread, which would otherwise be left to the garbage collector.
        self._client.reinitialise()
