"""Publishers on Zenoh, opened as a configuration would."""

from collections.abc import Sequence

from service.publish.zenoh import Publisher, ZenohConfig


def settings(listen: tuple[str, ...] = (), mode: str = "peer", connect: tuple[str, ...] = ()) -> ZenohConfig:
    return ZenohConfig(listen=listen, mode=mode, connect=connect)


def opened(table: ZenohConfig, zones: Sequence[str]) -> Publisher:
    """The publisher of the site "htwg" and these zones."""
    publisher = Publisher.open(table, "htwg")
    for zone in zones:
        publisher.add(zone)
    return publisher
