"""`cost`: time and memory of one sample on this machine (Table 9). Its runs have the machine to themselves."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from estimator import registry
from estimator.arrays import Array
from estimator.network.network import Network
from estimator.network.presets import network as preset
from replay.errors import ReplayError
from replay.experiments.jobs import Arrays, Job
from replay.experiments.progress import steps
from replay.experiments.request import Request
from replay.experiments.study import Contender, Figures, Results, Run, Study
from replay.lab.experiments import published
from replay.lab.experiments.semi_synthetic.case import simulated_case
from replay.lab.measuring.bench.machine import processor
from replay.reports.kit.report import Report, Section
from replay.simulated.semi_synthetic import PERIOD

SAMPLES = 400
WARM_UP = 40
"""Samples at the beginning that do not count: compilation, caches."""
REFERENCE_SAMPLES = 60
PARTICLES = (1000, 3000, 9000, 20_000)
PAPER_PARTICLES = 9000
MEDIAN, SLOW, RATE, SHARE, SIZE = "ms, median", "ms, 99 %", "samples/s", "% of 5 min", "state, MB"


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


def contenders(particles: Sequence[int]) -> list[Contender]:
    """RBPF with each number of particles, once in plain NumPy, then EKF and UKF."""
    compiled = [Contender(f"RBPF, {count:,} particles", "rbpf", {"particles": count}) for count in particles]
    count = PAPER_PARTICLES if PAPER_PARTICLES in particles else particles[-1]
    plain: dict[str, object] = {"particles": count, "implementation": "reference"}
    return [
        *compiled,
        Contender(f"RBPF, {count:,} particles, plain NumPy", "rbpf", plain),
        Contender("EKF", "ekf", {}),
        Contender("UKF", "ukf", {}),
    ]


def measure(run: CostRun) -> Arrays:
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
    held = sum(np.asarray(part).nbytes for part in state)
    return {"seconds": seconds, "state_bytes": np.array(held)}


def prepare(request: Request) -> Study:
    """The experiment for `request`; NetworkError or ReplayError where it cannot be made."""
    request.accept("data", "seeds", "particles", "network")
    networks = [preset(name) for name in ([request.network] if request.network else ["building-67", "ecolar-6r4c"])]
    seed, here = request.seeds_or(1)[0], processor()
    entered = contenders(PARTICLES if request.particles is None else (request.particles,))
    # What is measured does not matter to the time it takes; a day or two of the simulated building will do.
    short = Request(data=request.data, days=max(1, -(-SAMPLES * PERIOD // 86_400)))
    runs = []
    for network in steps(networks, "simulating"):
        series = simulated_case(network, short, seed).series
        if len(series.times) < SAMPLES:
            raise ReplayError(
                f"--data {request.file}: it has {len(series.times)} rows; {SAMPLES} are needed, which is three days"
            )
        for one in entered:
            samples = REFERENCE_SAMPLES if "implementation" in one.options else SAMPLES
            outputs, inputs = series.outputs[:samples], series.inputs[:samples]
            run = CostRun(one.estimator, one.options, network, PERIOD, outputs, inputs, seed, here)
            job = Job(f"{network.name} {one.label}", seed, measure, run)
            runs.append(Run(network.name, one.label, job))
    return Study(tuple(runs), lambda run, arrays: _figures(arrays), lambda results: _report(results, here))


def _figures(arrays: Arrays) -> Figures:
    seconds = arrays["seconds"][min(WARM_UP, (len(arrays["seconds"]) + 1) // 2) :]
    median, slow = float(np.median(seconds)), float(np.quantile(seconds, 0.99))
    size = float(arrays["state_bytes"]) / 1e6
    return {MEDIAN: 1000 * median, SLOW: 1000 * slow, RATE: 1.0 / median, SHARE: 100 * median / 300, SIZE: size}


def _report(results: Results, here: str) -> Report:
    paper = published.COST
    milliseconds, rate, share = 1000 * paper.update_seconds, 1.0 / paper.update_seconds, paper.update_seconds / 3
    row = (milliseconds, None, rate, share, paper.state_megabytes)
    table = results.table(
        "cost",
        "One sample: assimilate, learn, forecast, 95 % interval (Table 9)",
        {name: name for name in (MEDIAN, SLOW, RATE, SHARE, SIZE)},
        quoted={f"RBPF, {paper.particles:,} particles, paper (Table 9), building 67, Intel Xeon 2.20 GHz": row},
        note=f"Measured on {here}, one core. The paper's time is a mean, the middle of its range.",
    )
    lead = []
    for name in results.recordings:
        label = next((one for one in results.contenders if f"{PAPER_PARTICLES:,} particles" in one), "EKF")
        median = results.mean(name, label, MEDIAN)
        lead.append(
            f"{name}: {label} take {median:.2f} ms a sample; at a sampling period of 5 min one core of this machine "
            f"could serve {int(300_000 / median / 2):,} zones and still be idle half of the time."
        )
    return Report(
        "Cost of one sample",
        tuple(lead),
        (
            Section(
                "What was done",
                (
                    f"Each estimator took {SAMPLES} samples of a simulated building one after the other, plain NumPy "
                    f"{REFERENCE_SAMPLES}, with nothing else of this experiment running; other programs on the machine "
                    f"were not stopped. The first {WARM_UP} do not count, of plain NumPy the first half.",
                ),
            ),
            Section("What it costs", (), (table,)),
        ),
    )
