"""Publishers on Zenoh, opened as a configuration would."""

from __future__ import annotations

from collections.abc import Sequence

from adapters.zenoh.connection import Connection
from service.publish.zenoh import Publisher, ZenohConfig


def settings(listen: tuple[str, ...] = (), mode: str = "peer", connect: tuple[str, ...] = ()) -> Connection:
    return ZenohConfig(listen=listen, mode=mode, connect=connect).connection("htwg")


def opened(connection: Connection, zones: Sequence[str]) -> Publisher:
    """The publisher of the site "htwg" and these zones."""
    publisher = Publisher.open(connection, "htwg")
    for zone in zones:
        publisher.add(zone)
    return publisher
