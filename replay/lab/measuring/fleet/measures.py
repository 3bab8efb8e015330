"""What a run of the fleet tells: forecasts after their instants, answers of REST, the event loop, memory."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from replay.lab.measuring.fleet.clients import ENDPOINTS, Answer
from replay.lab.measuring.fleet.scenario import LONE_ROUNDS, Scenario
from replay.simulated.semi_synthetic import PERIOD

Arrivals = Mapping[float, Mapping[str, float]]
"""Per sample time (UTC s): when (monotonic s) the forecast of each zone arrived."""


def origin(arrivals: Arrivals, every: float) -> float:
    """When the first row was due, monotonic s, from the lone forecasts before the load.

    Each came a few ms after its instant, so the estimate is late by no more than the quickest of them took.
    """
    first = min(arrivals)
    lone = [(round((time - first) / PERIOD), min(heard.values())) for time, heard in arrivals.items()]
    return min(when - (index + 1) * every for index, when in lone if index < LONE_ROUNDS)


def rounds(arrivals: Arrivals, scenario: Scenario) -> list[dict[str, Any]]:
    """Per measured round: its instant (monotonic s), and s from there to the first, median and last forecast."""
    begin, start = min(arrivals), origin(arrivals, scenario.every)
    found = []
    for index in range(LONE_ROUNDS + 1, LONE_ROUNDS + 1 + scenario.rounds):
        instant = start + (index + 1) * scenario.every
        heard = sorted(when - instant for when in arrivals.get(begin + index * PERIOD, {}).values())
        found.append(
            {
                "instant": instant,
                "forecasts": len(heard),
                "missing": scenario.zones - len(heard),
                "first_s": heard[0] if heard else None,
                "median_s": float(np.median(heard)) if heard else None,
                "last_s": heard[-1] if heard else None,
            }
        )
    return found


def latencies(answers: Sequence[Answer], bursts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Latency of REST in s: of the promised endpoints while zones are being stepped and otherwise, and of each one."""
    intervals = [(burst["instant"], burst["instant"] + burst["last_s"]) for burst in bursts if burst["last_s"]]

    def busy(answer: Answer) -> bool:
        return any(begin <= answer.answered and answer.sent <= end for begin, end in intervals)

    promised = [answer for answer in answers if answer.endpoint in ENDPOINTS]
    during = [answer for answer in answers if busy(answer)]
    return {
        "during_bursts": summary([answer for answer in promised if busy(answer)]),
        "between_bursts": summary([answer for answer in promised if not busy(answer)]),
        "endpoints_during_bursts": {
            name: summary([answer for answer in during if answer.endpoint == name])
            for name in sorted({answer.endpoint for answer in during})
        },
    }


def summary(answers: Sequence[Answer]) -> dict[str, Any]:
    """Count, refused requests and quantiles in s."""
    if not answers:
        return {"requests": 0, "not_ok": 0, "p50_s": None, "p99_s": None, "max_s": None}
    seconds = [answer.answered - answer.sent for answer in answers]
    return {
        "requests": len(answers),
        "not_ok": sum(answer.status != 200 for answer in answers),
        "p50_s": float(np.quantile(seconds, 0.5)),
        "p99_s": float(np.quantile(seconds, 0.99)),
        "max_s": float(max(seconds)),
    }


def delay_buckets(metrics: str) -> dict[float, float]:
    """Upper bound in s to count of the event-loop delays in a Prometheus exposition, cumulated."""
    pattern = r'^thermogate_event_loop_delay_seconds_bucket\{le="([^"]+)"\} (\S+)$'
    return {float(bound): float(count) for bound, count in re.findall(pattern, metrics, re.MULTILINE)}


def loop_delays(before: Mapping[float, float], after: Mapping[float, float]) -> dict[str, Any]:
    """Delays between two scrapes: how many timers, how many later than .02 s, and the bound that none exceeded."""
    counts = {bound: after[bound] - before.get(bound, 0.0) for bound in sorted(after)}
    total = counts[max(counts)]
    within = min(bound for bound, count in counts.items() if count >= total)
    return {
        "timers": total,
        "later_than_20_ms": total - counts[0.02],
        "none_later_than_s": within if np.isfinite(within) else None,
        "cumulated": {f"{bound:g}": count for bound, count in counts.items()},
    }
