"""The zones that run, as everybody who serves them sees them."""

from collections.abc import ItemsView, Iterator, KeysView, Mapping, ValuesView
from typing import TypeVar

AnyZone = TypeVar("AnyZone")


class Zones(Mapping[str, AnyZone]):
    """Zones by id, in the order to list them. A reload replaces them all in one go: another thread never sees a
    dictionary that changes under its hands."""

    def __init__(self) -> None:
        self._zones: dict[str, AnyZone] = {}

    def replace(self, zones: Mapping[str, AnyZone]) -> None:
        """From now on these are the zones."""
        self._zones = dict(zones)

    def __getitem__(self, zone: str) -> AnyZone:
        return self._zones[zone]

    def __iter__(self) -> Iterator[str]:
        return iter(self._zones)

    def __len__(self) -> int:
        return len(self._zones)

    def keys(self) -> KeysView[str]:
        return self._zones.keys()

    def values(self) -> ValuesView[AnyZone]:
        return self._zones.values()

    def items(self) -> ItemsView[str, AnyZone]:
        return self._zones.items()
