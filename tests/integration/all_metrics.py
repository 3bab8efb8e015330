"""Every metric that a daemon has, without a daemon."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from service.instruments import instrument
from service.metrics import Metrics


def exposed() -> dict[str, str]:
    """Every metric of ours, as it is called in a scrape, with its type."""
    metrics = Metrics({})
    parts: Any = SimpleNamespace(tallies={}, feeds=(), zones={})
    instrument(metrics, parts, parts, None)
    return {
        f"{family.name}_total" if family.type == "counter" else family.name: family.type
        for family in metrics.registry.collect()
        if family.name.startswith("thermogate_")
    }
