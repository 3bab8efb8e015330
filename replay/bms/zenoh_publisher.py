"""The BMS's own Zenoh session, every channel again and again: `bms/plain/<device>/<channel>` and
`bms/json/<device>/<channel>` carry one value each, `bms/senml/<device>` all of a device. Publishers keep a cache and
can be detected, so that an advanced subscriber recovers what it missed."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress

import zenoh
import zenoh.ext

from adapters.fields.times import written_to_the_millisecond
from replay.bms.plant import Channel, Device
from replay.bms.simulation import Simulation
from replay.errors import ReplayError

CACHED = 60
"""Samples that each publisher keeps for those who come back."""
_EVERY = 1.0
_SENML_UNITS = {"degC": "Cel", "1": "/"}  # RFC 8428 and 8798; the others are written as they are


class ZenohPublisher:
    """An open session that listens on one loopback endpoint."""

    def __init__(self, session: zenoh.Session, simulation: Simulation) -> None:
        self._session = session
        self._simulation = simulation
        self._devices = simulation.plant
        self._publishers = {
            key: zenoh.ext.declare_advanced_publisher(
                session,
                key,
                encoding=zenoh.Encoding.TEXT_PLAIN if key.startswith("bms/plain/") else zenoh.Encoding.APPLICATION_JSON,
                congestion_control=zenoh.CongestionControl.DROP,
                cache=zenoh.ext.CacheConfig(max_samples=CACHED),
                sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=1.0, sporadic_heartbeat=None),
                publisher_detection=True,
            )
            for device in self._devices
            for key in _keys(device)
        }

    @classmethod
    def open(cls, endpoint: str, simulation: Simulation) -> ZenohPublisher:
        """Listen on `endpoint`; ReplayError if it cannot be had."""
        settings = {
            "mode": "peer",
            "listen/endpoints": [endpoint],
            "scouting/gossip/enabled": False,
            # A cache needs to know how old its samples are; plain payloads have no other time.
            "timestamping/enabled": True,
        }
        try:
            return cls(opened(settings), simulation)
        except zenoh.ZError as error:
            raise ReplayError(
                f"--zenoh {endpoint}: the endpoint cannot be used ({str(error).splitlines()[0].split(' at /')[0]}); "
                'choose another, or "off" for none'
            ) from None

    async def run(self) -> None:
        """Publish every second until cancelled."""
        while True:
            self.publish(time.time())
            await asyncio.sleep(_EVERY)

    def publish(self, now: float) -> None:
        """Put every channel once, stamped `now` (UTC seconds) as far as its device's clock is right."""
        faults = self._simulation.faults
        for device in self._devices:
            jump = faults.active("clock-jump", device.name)
            stamp = now + (jump.value if jump else 0.0)
            values = {
                channel: self._simulation.value(device, channel)
                for channel in device.channels
                if not faults.active("silent", device.name, channel.name)
            }
            for key, payload in _payloads(device, values, stamp):
                self._publishers[key].put(payload)

    def close(self) -> None:
        """Undeclare everything and close the session; may take for ever."""
        for step in (*(publisher.undeclare for publisher in self._publishers.values()), self._session.close):
            with suppress(zenoh.ZError):
                step()


def _payloads(device: Device, values: Mapping[Channel, float], stamp: float) -> Iterator[tuple[str, bytes]]:
    """By key what is put for `values` of channels, NaN for "not available" (in SenML null), at UTC seconds `stamp`."""
    pack: list[dict[str, object]] = []
    for channel, value in values.items():
        place = f"{device.name}/{channel.name}"
        missing, shown = math.isnan(value), None if math.isnan(value) else round(value, 6)
        document = {
            "present": {"value": shown, "unit": channel.unit},
            "time": written_to_the_millisecond(stamp),
            "quality": "bad" if missing else "good",
        }
        yield f"bms/plain/{place}", f"{value:.6g}".encode()
        yield f"bms/json/{place}", json.dumps(document).encode()
        record = {"n": channel.name, "u": _SENML_UNITS.get(channel.unit, channel.unit), "v": shown}
        pack.append({**({} if pack else {"bn": f"{device.name}/"}), **record, "t": round(stamp, 3)})
    if pack:
        yield f"bms/senml/{device.name}", json.dumps(pack).encode()


def opened(settings: Mapping[str, object]) -> zenoh.Session:
    """A session with `settings` and without multicast scouting; ZError where it cannot be opened."""
    config = zenoh.Config()
    for key, value in {"scouting/multicast/enabled": False, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def _keys(device: Device) -> list[str]:
    single = [f"bms/{form}/{device.name}/{channel.name}" for form in ("plain", "json") for channel in device.channels]
    return [*single, f"bms/senml/{device.name}"]
