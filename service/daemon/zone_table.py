"""The zones that run, as everybody who serves them sees them."""

from collections import UserDict
from collections.abc import ItemsView, KeysView, Mapping, ValuesView
from typing import TypeVar

AnyZone = TypeVar("AnyZone")


class Zones(UserDict[str, AnyZone]):
    """Zones by id, in the order to list them.

    A reload replaces them all in one go, so that another thread sees those before or those after, and never a
    dictionary that changes under its hands.
    """

    def replace(self, zones: Mapping[str, AnyZone]) -> None:
        """From now on these are the zones."""
        self.data = dict(zones)

    def keys(self) -> KeysView[str]:
        return self.data.keys()

    def values(self) -> ValuesView[AnyZone]:
        return self.data.values()

    def items(self) -> ItemsView[str, AnyZone]:
        return self.data.items()
