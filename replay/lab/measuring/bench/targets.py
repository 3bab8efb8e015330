"""The targets, and the measured figure beside each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

Sections = Mapping[str, Mapping[str, Any]]


class Row(NamedTuple):
    """What is measured, in `section`; the target, the measured figure as text, and whether the target is met."""

    section: str
    what: str
    target: str
    measured: Callable[[Mapping[str, Any]], str]
    met: Callable[[Mapping[str, Any]], bool]


def _ms(seconds: float | None) -> str:
    return "none" if seconds is None else f"{1e3 * seconds:.3g} ms"


def _s(seconds: float | None) -> str:
    return "none" if seconds is None else f"{seconds:.3g} s"


def _below(value: float | None, limit: float) -> bool:
    return value is not None and value <= limit


def _linear(exponent: float) -> bool:
    return exponent <= 1.1


ROWS = (
    Row(
        "update",
        "one complete update, one thread",
        "at most 1.5 ms",
        lambda r: (
            f"{_ms(r['compiled']['median_s'])} ({_ms(r['compiled']['lower_quartile_s'])} to "
            f"{_ms(r['compiled']['upper_quartile_s'])})"
        ),
        lambda r: _below(r["compiled"]["median_s"], 1.5e-3),
    ),
    Row(
        "update",
        "the project's own NumPy oracle, same run",
        "at least 20 times slower",
        lambda r: f"{_ms(r['oracle']['median_s'])}, {r['ratio']:.1f} times",
        lambda r: bool(r["ratio"] >= 20.0),
    ),
    Row(
        "threads",
        "updates of two zones on two threads, against one thread",
        "at least 1.7 times one thread, same bits",
        lambda r: (
            f"{_ms(r['two_threads']['median_s'])}, {r['ratio']:.2f} times, {'same' if r['same_bits'] else 'OTHER'} bits"
        ),
        lambda r: bool(r["ratio"] >= 1.7 and r["same_bits"]),
    ),
    Row(
        "growth",
        "growth in particles: time ~ N^p",
        "linear",
        lambda r: (
            f"p = {r['particles_exponent']:.2f} from {r['particles'][0]['particles']:,} to "
            f"{r['particles'][-1]['particles']:,}"
        ),
        lambda r: _linear(r["particles_exponent"]),
    ),
    Row(
        "growth",
        "growth in zones: time of a sweep ~ zones^p",
        "linear",
        lambda r: f"p = {r['zones_exponent']:.2f} from {r['zones'][0]['zones']:,} to {r['zones'][-1]['zones']:,}",
        lambda r: _linear(r["zones_exponent"]),
    ),
    Row(
        "months",
        "five months at 600 s, `thermogate replay`",
        "under 60 s",
        lambda r: f"{_s(r['wall_s'])} for {r['samples']:,} samples, peak {r['peak_resident_bytes'] / 1e6:.0f} MB",
        lambda r: _below(r["wall_s"], 60.0),
    ),
    Row(
        "memory",
        "memory of a zone beyond a fixed base",
        "at most 2.6 MB",
        lambda r: f"{r['bytes_per_zone'] / 1e6:.2f} MB beyond {r['base_bytes'] / 1e6:.0f} MB",
        lambda r: _below(r["bytes_per_zone"], 2.6e6),
    ),
    Row(
        "fleet",
        "resident memory of the daemon with all zones",
        "under 3 GB",
        lambda r: f"{r['resident_bytes'] / 1e9:.2f} GB with {r['scenario']['zones']:,} zones",
        lambda r: _below(r["resident_bytes"], 3e9),
    ),
    Row(
        "fleet",
        "all samples at the same instant: last forecast",
        "within 3 s",
        lambda r: f"{_s(r['last_forecast_s'])}, the slowest of {len(r['rounds'])} instants",
        lambda r: _below(r["last_forecast_s"], 3.0) and r["missing_forecasts"] == 0,
    ),
    Row(
        "fleet",
        "REST meanwhile, 99th percentile",
        "under 25 ms",
        lambda r: f"{_ms(r['rest']['during_bursts']['p99_s'])} of {r['rest']['during_bursts']['requests']:,} requests",
        lambda r: _below(r["rest"]["during_bursts"]["p99_s"], 0.025),
    ),
    Row(
        "fleet",
        "event loop held",
        "never longer than 20 ms",
        lambda r: (
            f"{r['event_loop']['later_than_20_ms']:.0f} of {r['event_loop']['timers']:,.0f} timers later; none "
            f"later than {_ms(r['event_loop']['none_later_than_s'])}"
        ),
        lambda r: bool(r["event_loop"]["later_than_20_ms"] == 0),
    ),
    Row(
        "control",
        "fans of 50 zones over 24 h of 5 min, one request",
        "at most 2 s",
        lambda r: ", ".join(
            f"{name} {_s(found['fans']['median_s'])} (processor {_s(found['processor_s'])})"
            for name, found in r["estimators"].items()
        ),
        lambda r: all(_below(found["fans"]["median_s"], 2.0) for found in r["estimators"].values()),
    ),
    Row(
        "start",
        "start to serving a forecast, warm kernel cache",
        "under 2 s",
        lambda r: f"{_s(r['warm']['first_forecast_s'])}; REST answers after {_s(r['warm']['serving_s'])}",
        lambda r: _below(r["warm"]["first_forecast_s"], 2.0),
    ),
    Row(
        "start",
        "start to serving a forecast, cold",
        "under 20 s",
        lambda r: f"{_s(r['cold']['first_forecast_s'])}; REST answers after {_s(r['cold']['serving_s'])}",
        lambda r: _below(r["cold"]["first_forecast_s"], 20.0),
    ),
    Row(
        "start",
        "one compilation serves every network and count",
        "nothing compiled anew",
        lambda r: (
            f"{r['another_network_first']['kernels_compiled']} kernels for another network, "
            f"{r['another_network_then']['kernels_compiled']} for another count"
        ),
        lambda r: r["another_network_first"]["kernels_compiled"] + r["another_network_then"]["kernels_compiled"] == 0,
    ),
)


class Judged(NamedTuple):
    """A row as text."""

    what: str
    target: str
    measured: str
    verdict: str


def judged(sections: Sections) -> list[Judged]:
    """Every row whose section was run, with `met`, `missed`, or why there is no figure."""
    rows = []
    for row in ROWS:
        found = sections.get(row.section)
        if found is None:
            continue
        reason = next((f"{word}: {found[word]}" for word in ("skipped", "failed") if word in found), None)
        if reason is not None:
            rows.append(Judged(row.what, row.target, reason, "no figure"))
        else:
            rows.append(Judged(row.what, row.target, row.measured(found), "met" if row.met(found) else "missed"))
    return rows
