"""The results as a Markdown page with pictures, and as lines for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from replay.lab.measuring.bench.targets import Sections, judged

_STATEMENT = (
    "Written by `make bench`; do not edit. Every figure below was measured in one run on the machine named here, each "
    "section in a process of its own; a section that was measured elsewhere names its machine. A median is followed by "
    "its quartiles."
)


def table(sections: Sections) -> list[str]:
    """The targets and the figures for a terminal."""
    return [f"{row.verdict:9} {row.what}: {row.measured} (target: {row.target})" for row in judged(sections)]


def page(results: Mapping[str, Any], path: Path) -> None:
    """Write the page to `path`, and its pictures beside it in `images`."""
    sections = results["sections"]
    lines = ["# Performance", "", _STATEMENT, ""]
    if results["size"] != "full":
        lines += [f"**Size `{results['size']}`: these figures only show that the measurements run.**", ""]
    lines += _machine(results["machine"]) + _elsewhere(results["machine"], sections) + _targets(sections)
    written = {"stages": _stages, "growth": _growth, "comparisons": _comparisons, "fleet": _fleet}
    for name, write in written.items():
        found = sections.get(name, {})
        if found and "failed" not in found and "skipped" not in found:
            lines += write(found)
    from replay.lab.measuring.bench.plots import draw

    pictures = draw(sections, path.parent / "images")
    for picture, caption in pictures.items():
        lines += ["", f"![{caption}](images/{picture})", "", f"*{caption}*"]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _rows(header: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    return [
        "| " + " | ".join(header) + " |",
        "|" + "---|" * len(header),
        *("| " + " | ".join(map(str, row)) + " |" for row in rows),
    ]


def _machine(found: Mapping[str, Any]) -> list[str]:
    libraries = ", ".join(f"{name} {version or '(not installed)'}" for name, version in found["libraries"].items())
    return _rows(
        ("machine", ""),
        [
            ("processor", found["processor"]),
            ("cores", found["cores"]),
            ("memory", f"{found['memory_bytes'] / 1e9:.1f} GB"),
            ("system", found["system"]),
            ("Python", found["python"]),
            ("libraries", libraries),
            ("Thermogate", f"{found['thermogate']}, commit {found['commit'] or 'unknown'}"),
            ("date", found["date"]),
            ("load average before", f"{found['load_average_before']:.2f}"),
        ],
    )


def _elsewhere(run: Mapping[str, Any], sections: Sections) -> list[str]:
    """What was measured on another machine, commit or day than the rest."""
    lines: list[str] = []
    for name, found in sections.items():
        own = found.get("machine", run)
        if any(own[fact] != run[fact] for fact in ("processor", "commit", "date")):
            lines += ["", f"`{name}`: measured on {_where(own)}."]
    return lines


def _where(own: Mapping[str, Any]) -> str:
    return (
        f"{own['processor']}, commit {own['commit'] or 'unknown'}, {own['date']}; load average before: "
        f"{own['load_average_before']:.1f} on {own['cores']} cores"
    )


def _targets(sections: Sections) -> list[str]:
    update = sections.get("update", {})
    particles = f"{update['particles']:,}" if "particles" in update else "9,000"
    return [
        "",
        "## Targets",
        "",
        f"N = {particles} particles, the network of building 67: five states, all ten parameters free. A complete "
        "update is the measurement update and its weights, the gate, resampling when due, rejuvenation of all "
        "parameters, the volatility step, the exact zero-order hold, the Kalman prediction, and median and interval at "
        ".95.",
        "",
        *_rows(
            ("work", "target", "measured", ""),
            [(row.what, row.target, row.measured, row.verdict) for row in judged(sections)],
        ),
    ]


def _stages(found: Mapping[str, Any]) -> list[str]:
    floor, peak, whole = found["floor"], found["peak"], found["instrumented_update_s"]
    prediction = found["prediction"]
    operations = floor["operations_per_particle"]
    return [
        "",
        "## Where the time of one update goes",
        "",
        f"One thread, {1e3 * found['update_s']:.2f} ms an update on average ({1e3 * whole:.2f} ms with the clocks). "
        "`between` is Python and NumPy around the timed calls.",
        "",
        *_rows(
            ("call", "us", "share", "calls an update"),
            [
                (f"`{name}`", f"{1e6 * one['s']:.0f}", f"{one['s'] / whole:.0%}", f"{one['calls']:.2f}")
                for name, one in found["stages"].items()
            ],
        ),
        "",
        f"`predict` as a whole takes {1e3 * prediction['predict_s']:.2f} ms, of which the squarings of the exponential "
        f"{1e3 * prediction['squarings_s']:.2f} ms.",
        "",
        "### The floor",
        "",
        f"Measured peak of one core: {peak['flops_per_s'] / 1e9:.1f} Gflop/s in float64 multiply-adds, "
        f"{peak['bytes_per_s'] / 1e9:.1f} GB/s from memory. One update is {floor['operations'] / 1e6:.1f} million "
        f"operations, {1e3 * floor['operations_s']:.2f} ms at that peak; reading and writing its state once is "
        f"{floor['bytes'] / 1e6:.1f} MB, {1e3 * floor['bytes_s']:.2f} ms. The measured update is "
        f"{found['update_s'] / floor['operations_s']:.1f} times the floor in operations. Counts are those of the "
        "method in float64 (`replay/lab/measuring/bench/floor.py`), with "
        f"{floor['squarings']:.1f} squarings on average.",
        "",
        *_rows(
            ("stage", "operations a particle", "us at the peak"),
            [
                (name, f"{count:.0f}", f"{1e6 * floor['stages_s'][name]:.0f}")
                for name, count in sorted(operations.items(), key=lambda item: -item[1])
            ],
        ),
    ]


def _growth(found: Mapping[str, Any]) -> list[str]:
    return [
        "",
        "## Growth",
        "",
        f"One thread. Exponents of the growth: {found['particles_exponent']:.2f} in particles, "
        f"{found['zones_exponent']:.2f} in zones of {found['particles_of_a_zone']:,} particles; 1 is linear.",
        "",
        *_rows(
            ("particles", "ms an update", "us per 1,000 particles"),
            [
                (
                    f"{row['particles']:,}",
                    f"{1e3 * row['median_s']:.2f}",
                    f"{1e9 * row['median_s'] / row['particles']:.0f}",
                )
                for row in found["particles"]
            ],
        ),
        "",
        *_rows(
            ("zones", "ms a sweep", "ms a zone"),
            [
                (f"{row['zones']:,}", f"{1e3 * row['median_s']:.1f}", f"{1e3 * row['median_s'] / row['zones']:.2f}")
                for row in found["zones"]
            ],
        ),
    ]


def _comparisons(found: Mapping[str, Any]) -> list[str]:
    names = {
        "thermogate": "Thermogate's prediction and measurement update",
        "jax": "JAX, `vmap` and `jit`, float64",
        "cuthbert": "cuthbert (square-root form) under `vmap` and `jit`, float64",
        "filterpy": "a loop over filterpy's `KalmanFilter`",
    }
    rows = []
    for name, label in names.items():
        one = found[name]
        if "skipped" in one:
            rows.append((label, one["skipped"], "", ""))
        else:
            ratio = f"{one['ratio']:.1f}" if "ratio" in one else "1"
            rows.append((label, f"{one['particles']:,}", f"{1e9 * one['per_particle_s']:.0f}", ratio))
    return [
        "",
        "## The Kalman step by other means",
        "",
        "Exact zero-order hold, prediction and one scalar measurement update of every particle, on one processor. Each "
        "of the others takes the exponential of the augmented matrix. It is the core of an update, not all of it.",
        "",
        *_rows(("implementation", "particles", "ns a particle", "times ours"), rows),
    ]


def _fleet(found: Mapping[str, Any]) -> list[str]:
    scenario, rest = found["scenario"], found["rest"]
    return [
        "",
        "## A fleet on the real daemon",
        "",
        f"{scenario['zones']:,} zones of {scenario['preset']} with {scenario['particles']:,} particles, whose samples "
        f"land at the same instant every {scenario['every']:g} s; a Zenoh subscriber to every forecast and "
        f"{rest['clients']} REST clients (thinking {1e3 * rest['pause_s']:.0f} ms on average) run on the same machine. "
        "An instant is known from the quickest forecast of a lone zone before the load, so times after it are too "
        f"short by the few ms that took. Processor time of the daemon: {found['cpu_seconds_per_round']:.1f} s an "
        f"instant. It served {found['serving_after_s']:.1f} s after its start.",
        "",
        *_rows(
            ("instant", "first forecast", "median", "last", "missing"),
            [
                (number, *(_time(one[key]) for key in ("first_s", "median_s", "last_s")), one["missing"])
                for number, one in enumerate(found["rounds"], start=1)
            ],
        ),
        "",
        "REST while zones are being stepped. The first four endpoints are those of the target; the others are computed "
        "on request or list every zone, and one client asks for one of them a second.",
        "",
        *_rows(
            ("endpoint", "requests", "not 200", "p50", "p99", "max"),
            [
                (name, one["requests"], one["not_ok"], *(_time(one[key]) for key in ("p50_s", "p99_s", "max_s")))
                for name, one in sorted(rest["endpoints_during_bursts"].items(), key=lambda item: -item[1]["requests"])
            ],
        ),
    ]


def _time(value: float | None) -> str:
    if value is None:
        return "none"
    return f"{value:.2f} s" if value >= 1.0 else f"{1e3 * value:.1f} ms"
