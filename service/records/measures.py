"""Figures that are read at the moment of a scrape, offered by whoever owns them.

An owner (the store, the sources, the zones) has a function `..._measures` that returns a list of `Measure`s;
`service.daemon.instruments` registers them all.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal, NamedTuple

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

Rows = Iterable[tuple[tuple[str, ...], float]]
"""Values of the labels, and the figure."""


class Measure(NamedTuple):
    """A metric without a memory of its own. `read` is called from any thread and must not wait.

    `name` is without the `_total` of a counter; its unit, if it has one, ends it, as Prometheus has it.
    """

    name: str
    kind: Literal["gauge", "counter"]
    text: str
    labels: tuple[str, ...]
    read: Callable[[], Rows]

    @classmethod
    def called(cls, name: str, read: Callable[[], Rows]) -> Measure:
        """The one that `measures.toml` describes under this name."""
        kind, text, *labels = _DESCRIBED[name]
        return cls(name, kind, text, tuple(labels), read)


_DESCRIBED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def single(value: float) -> Rows:
    """The rows of a measure without labels."""
    return (((), value),)


def family(measure: Measure) -> Metric:
    """What `measure` says now."""
    kind = CounterMetricFamily if measure.kind == "counter" else GaugeMetricFamily
    found = kind(measure.name, measure.text, labels=measure.labels)
    for labels, value in measure.read():
        found.add_metric(labels, value)
    return found
