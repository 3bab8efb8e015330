"""Figures that are read at the moment of a scrape, offered by whoever owns them: the store, the sinks, the server."""

import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

Rows = Iterable[tuple[tuple[str, ...], float]]
"""Values of the labels, and the figure."""


@dataclass(frozen=True)
class Measure(Collector):
    """A metric without a memory of its own, called `name` without the `_total` of a counter. `read` is called at a
    scrape, from any thread, and must not wait."""

    name: str
    kind: Literal["gauge", "counter"]
    text: str
    labels: tuple[str, ...]
    read: Callable[[], Rows]

    @classmethod
    def called(cls, name: str, read: Callable[[], Rows]) -> Self:
        """The one that `measures.toml` describes under this name."""
        kind, text, *labels = _DESCRIBED[name]
        return cls(name, kind, text, tuple(labels), read)

    def collect(self) -> Iterable[Metric]:
        (found,) = self.describe()
        for labels, value in self.read():
            found.add_metric(labels, value)  # type: ignore[attr-defined]
        return (found,)

    def describe(self) -> Iterable[Metric]:
        """The family alone: nothing is read for a registration."""
        kind = CounterMetricFamily if self.kind == "counter" else GaugeMetricFamily
        return (kind(self.name, self.text, labels=self.labels),)


_DESCRIBED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def single(value: float) -> Rows:
    """The rows of a measure without labels."""
    return (((), value),)
