"""The other side of a Zenoh source: sessions that publish on loopback, certificates, and a listener to batches."""

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Any

import zenoh
import zenoh.ext
from support.certificates import make_pair
from support.processes import free_port, listens
from support.waiting import until

from adapters.reading import Batch, Reading, Source

TLS = "transport/link/tls/"
USER = "transport/auth/usrpwd/"
QUICK = {"connect/retry": {"period_init_ms": 100, "period_max_ms": 300, "period_increase_factor": 2}}


def endpoint(protocol: str = "tcp") -> str:
    return f"{protocol}/127.0.0.1:{free_port()}"


def open_session(settings: Mapping[str, object], base: zenoh.Config | None = None) -> zenoh.Session:
    """A session that finds nobody by itself, with Zenoh's keys in `settings`."""
    config = base or zenoh.Config()
    for key, value in {"scouting/multicast/enabled": False, "timestamping/enabled": True, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


@contextmanager
def session(
    mode: str = "peer", listen: str | None = None, connect: str | None = None, **settings: object
) -> Iterator[zenoh.Session]:
    """A session with the keys in `settings` ("/" written as "__")."""
    places = {"listen/endpoints": [listen] if listen else [], "connect/endpoints": [connect] if connect else []}
    others = {key.replace("__", "/"): value for key, value in settings.items()}
    opened = open_session({"mode": mode, **places, **others})
    try:
        yield opened
    finally:
        with suppress(zenoh.ZError):
            opened.close()


async def opened(place: str) -> None:
    """Wait until a session listens at `place`, which is another's to open."""
    await until(lambda: listens(int(place.rpartition(":")[2])))


def caching_publisher(session: zenoh.Session, key: str) -> Any:
    """A publisher that keeps what it published and can be detected."""
    return zenoh.ext.declare_advanced_publisher(
        session,
        key,
        cache=zenoh.ext.CacheConfig(max_samples=100),
        sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=0.2, sporadic_heartbeat=None),
        publisher_detection=True,
    )


class Listener:
    """Takes in what a source delivers, and comes back after failures as the daemon does, only sooner."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.readings: list[Reading] = []
        self.batches: list[Batch] = []
        self.failures: list[str] = []

    async def listen(self) -> None:
        while True:
            try:
                async for batch in self.source.batches(None):
                    self.batches.append(batch)
                    self.readings += batch.readings
            except Exception as error:
                self.failures.append(str(error))
            await asyncio.sleep(0.05)

    def values(self, channel: str = "room/T") -> list[float]:
        """The good values of a channel in the order in which they came."""
        return [reading.value for reading in self.readings if reading.channel == channel and reading.fault is None]

    def faults(self) -> list[str]:
        return [str(reading.fault) for reading in self.readings if reading.channel == "room/T" and reading.fault]

    async def until(self, done: Callable[[], object], act: Callable[[], object] = lambda: None) -> None:
        """Wait until `done`, doing `act` again and again."""
        deadline = time.monotonic() + 180
        while not done():
            assert time.monotonic() < deadline, (self.readings[-5:], self.failures)
            act()
            await asyncio.sleep(0.05)


@asynccontextmanager
async def listening(source: Source) -> AsyncIterator[Listener]:
    listener = Listener(source)
    task = asyncio.create_task(listener.listen())
    try:
        yield listener
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        await source.close()


def certificates(folder: Path, names: tuple[str, ...] = ("server", "client")) -> Path:
    """`folder` with ca.pem, and for each of `names` and "stranger" NAME.pem and NAME.key; the stranger's is signed by
    another authority."""
    for authority, signed in (("ca", names), ("other", ("stranger",))):
        signer = make_pair(folder, authority)
        for name in signed:
            make_pair(folder, name, signer=signer)
    return folder
