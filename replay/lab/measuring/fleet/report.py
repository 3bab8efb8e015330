"""The figures of a fleet beside their targets, as lines of text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def lines(result: Mapping[str, Any]) -> list[str]:
    """A few lines for a terminal."""
    rest, loop = result["rest"], result["event_loop"]
    during = rest["during_bursts"]
    found = [
        f"serving after {result['serving_after_s']:.1f} s; stopped in {result['stop_s']:.1f} s",
        f"last forecast {seconds(result['last_forecast_s'])} after the instant (target 3 s), rounds: "
        + ", ".join(seconds(one["last_s"]) for one in result["rounds"])
        + f"; {result['missing_forecasts']} forecasts missing",
        f"REST during the bursts: {during['requests']} requests, {during['not_ok']} not ok, "
        f"p50 {milliseconds(during['p50_s'])}, p99 {milliseconds(during['p99_s'])} (target 25 ms), "
        f"max {milliseconds(during['max_s'])}",
    ]
    found += [
        f"  {name}: {one['requests']} requests, p50 {milliseconds(one['p50_s'])}, p99 {milliseconds(one['p99_s'])}, "
        f"max {milliseconds(one['max_s'])}"
        for name, one in rest["endpoints_during_bursts"].items()
    ]
    return [
        *found,
        f"REST between the bursts: p99 {milliseconds(rest['between_bursts']['p99_s'])}",
        f"event loop: {loop['later_than_20_ms']:.0f} of {loop['timers']:.0f} timers later than 20 ms (target none), "
        f"none later than {seconds(loop['none_later_than_s'])}",
        f"resident memory {result['resident_bytes'] / 1e9:.2f} GB (target for 1,000 zones 3 GB)",
        f"processor time {result['cpu_seconds_per_round']:.2f} s a round",
    ]


def seconds(value: float | None) -> str:
    """A time in s, or that there is none."""
    return "none" if value is None else f"{value:.2f} s"


def milliseconds(value: float | None) -> str:
    """A time in ms, or that there is none."""
    return "none" if value is None else f"{1000 * value:.1f} ms"
