"""`cost`: time and memory of one sample on this machine (Table 9). Its runs have the machine to themselves."""

from __future__ import annotations

import platform
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go

from estimator import registry
from estimator.arrays import Array
from estimator.network.network import Network
from estimator.network.presets import network as preset
from replay.errors import ReplayError
from replay.experiments import published
from replay.experiments.jobs import Arrays, Job, Tick
from replay.experiments.progress import steps
from replay.experiments.report import Plot, Report, Section
from replay.experiments.request import Request
from replay.experiments.semi_synthetic.case import simulated_case
from replay.experiments.semi_synthetic.plots import COLOURS
from replay.experiments.table import Cell, Table
from replay.simulated.semi_synthetic import PERIOD

SAMPLES = 400
WARM_UP = 40
"""Samples at the beginning that do not count: compilation, caches."""
REFERENCE_SAMPLES = 60
PARTICLES = (1000, 3000, 9000, 20_000)
PAPER_PARTICLES = 9000


class CostRun(NamedTuple):
    """What a measurement depends on, the machine included."""

    estimator: str
    options: Mapping[str, object]
    network: Network
    period: float
    outputs: Array
    inputs: Array
    seed: int
    machine: str


class Contender(NamedTuple):
    """One row of the table."""

    label: str
    estimator: str
    options: Mapping[str, object]
    samples: int = SAMPLES


def contenders(particles: Sequence[int]) -> list[Contender]:
    """RBPF with each number of particles, once in plain NumPy, then EKF and UKF."""
    compiled = [Contender(f"RBPF, {count:,} particles", "rbpf", {"particles": count}) for count in particles]
    count = PAPER_PARTICLES if PAPER_PARTICLES in particles else particles[-1]
    plain: dict[str, object] = {"particles": count, "implementation": "reference"}
    return [
        *compiled,
        Contender(f"RBPF, {count:,} particles, plain NumPy", "rbpf", plain, REFERENCE_SAMPLES),
        Contender("EKF", "ekf", {}),
        Contender("UKF", "ukf", {}),
    ]


def measure(run: CostRun, tick: Tick) -> Arrays:
    """`seconds` (K - 1,) of each sample as the daemon takes it, and `state_bytes` of the state between samples."""
    estimator = registry.build(run.estimator, run.network, run.period, run.options)
    outputs, inputs, tails = run.outputs, run.inputs, np.array([0.025, 0.5, 0.975])
    state = estimator.predict(estimator.start(run.seed, outputs[0], inputs[0]), inputs[0])
    seconds = np.empty(len(outputs) - 1)
    for k in range(1, len(outputs)):
        began = time.perf_counter()
        state = estimator.predict(estimator.update(state, outputs[k]).state, inputs[k])
        estimator.quantiles(estimator.predictive(state), tails, 0)
        seconds[k - 1] = time.perf_counter() - began
        tick(1)
    held = sum(np.asarray(part).nbytes for part in state)
    return {"seconds": seconds, "state_bytes": np.array(held)}


class Cost:
    """The experiment, made ready."""

    def __init__(self, request: Request) -> None:
        request.accept("data", "seeds", "particles", "network")
        names = [request.network] if request.network else ["building-67", "ecolar-6r4c"]
        self._networks = [preset(name) for name in names]
        self._seed = request.seeds_or(1)[0]
        particles = PARTICLES if request.particles is None else (request.particles,)
        self._contenders = contenders(particles)
        # What is measured does not matter to the time it takes; a day or two of the simulated building will do.
        short = Request(data=request.data, days=max(1, -(-SAMPLES * PERIOD // 86_400)))
        self._series = [
            simulated_case(network, short, self._seed).series for network in steps(self._networks, "simulating")
        ]
        rows = len(self._series[0].times)
        if rows < SAMPLES:
            raise ReplayError(f"--data {request.file}: it has {rows} rows; {SAMPLES} are needed, which is three days")
        self._machine = machine()

    def jobs(self) -> list[Job]:
        """Network by network, contender by contender."""
        return [
            Job(
                f"{network.name} {contender.label}",
                self._seed,
                measure,
                CostRun(
                    contender.estimator,
                    contender.options,
                    network,
                    PERIOD,
                    series.outputs[: contender.samples],
                    series.inputs[: contender.samples],
                    self._seed,
                    self._machine,
                ),
                contender.samples - 1,
            )
            for network, series in zip(self._networks, self._series, strict=True)
            for contender in self._contenders
        ]

    def report(self, results: Sequence[Arrays]) -> Report:
        """Table 9."""
        rest = iter(results)
        rows: list[tuple[Cell, ...]] = []
        times: dict[str, dict[str, float]] = {}
        for network in self._networks:
            for contender in self._contenders:
                arrays = next(rest)
                seconds = arrays["seconds"][min(WARM_UP, contender.samples // 2) :]
                median, slow = float(np.median(seconds)), float(np.quantile(seconds, 0.99))
                times.setdefault(network.name, {})[contender.label] = median
                size = float(arrays["state_bytes"]) / 1e6
                rows.append(
                    (network.name, contender.label, 1000 * median, 1000 * slow, 1.0 / median, 100 * median / 300, size)
                )
        paper = published.COST
        rows.append(
            (
                "building-67",
                f"RBPF, {paper.particles:,} particles, paper (Table 9), Intel Xeon 2.20 GHz",
                1000 * paper.update_seconds,
                None,
                1.0 / paper.update_seconds,
                100 * paper.update_seconds / 300,
                paper.state_megabytes,
            )
        )
        table = Table(
            "cost",
            "One sample: assimilate, learn, forecast, 95 % interval (Table 9)",
            ("network", "estimator", "ms, median", "ms, 99 %", "samples/s", "% of 5 min", "state, MB"),
            tuple(rows),
            f"Measured on {self._machine}, one core. The paper's time is a mean, the middle of its range.",
            1,
        )
        return Report(
            "Cost of one sample",
            _lead(times),
            (
                Section(
                    "What was done",
                    (
                        f"Each estimator took {SAMPLES} samples of a simulated building one after the other, plain "
                        f"NumPy {REFERENCE_SAMPLES}, with nothing else of this experiment running; other programs on "
                        f"the machine were not stopped. The first {WARM_UP} do not count, of plain "
                        "NumPy the first half.",
                    ),
                ),
                Section("What it costs", (), (table,), (_plot(times),)),
                Section(
                    "What to set",
                    (
                        "Zones are independent: add up the times of yours and divide by the number of cores. If the "
                        "sum is well below the sampling period there is nothing to set. Otherwise reduce `particles`; "
                        "`thermogate experiment sensitivity` shows what that costs in accuracy.",
                    ),
                ),
            ),
        )


def prepare(request: Request) -> Cost:
    """The experiment for `request`; NetworkError or ReplayError where it cannot be made."""
    return Cost(request)


def machine() -> str:
    """The processor's name, as far as the system tells, and what runs on it."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), name)
    except OSError:
        pass  # not Linux
    return f"{name}, Python {platform.python_version()}"


def _lead(times: Mapping[str, Mapping[str, float]]) -> tuple[str, ...]:
    sentences = []
    for network, by_label in times.items():
        label = next((label for label in by_label if f"{PAPER_PARTICLES:,} particles" in label), next(iter(by_label)))
        seconds = by_label[label]
        sentences.append(
            f"{network}: {label} take {1000 * seconds:.2f} ms a sample; at a sampling period of 5 min one core of this "
            f"machine could serve {int(300 / seconds / 2):,} zones and still be idle half of the time."
        )
    return tuple(sentences)


def _plot(times: Mapping[str, Mapping[str, float]]) -> Plot:
    figure = go.Figure()
    for place, (network, by_label) in enumerate(times.items()):
        milliseconds = [1000 * seconds for seconds in by_label.values()]
        figure.add_trace(go.Bar(x=list(by_label), y=milliseconds, name=network, marker_color=COLOURS[place]))
    figure.update_layout(barmode="group", yaxis={"title": "ms per sample", "type": "log"})
    return Plot(
        "Time of one sample", figure, "Medians, on a logarithmic scale. It grows in proportion to the particles."
    )
