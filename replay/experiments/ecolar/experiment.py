"""`ecolar`: a real zone, where no truth is known (5.2): Ecolar Home's recordings, or synthetic stand-ins for them."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.network.network import Network
from estimator.network.presets import network as preset
from replay.errors import ReplayError
from replay.experiments.ecolar.nights import NightRun, night_job
from replay.experiments.ecolar.report import LEAST_SQUARES, PeriodOutcome, Run, report
from replay.experiments.jobs import Arrays, Job
from replay.experiments.progress import steps
from replay.experiments.report import Report
from replay.experiments.request import Request, names_of
from replay.experiments.series.filtering import FilterRun, Series, Trace
from replay.experiments.series.least_squares import LeastSquaresRun, segments_of
from replay.experiments.series.networks import network_of
from replay.experiments.series.recorded import series_of
from replay.simulated.ecolar import COLUMNS, HEATER_COLUMNS, PERIODS, ZONE, write_standin
from service.config.load import Config, load

NETWORK = "ecolar-6r4c"
PERIOD = 300
MEASUREMENT_SD = 0.1
"""K, the data sheet's."""
SEEDS = 3
_STARTS = 4
_SHORTEST_SEGMENT = 12

_CONFIGURATION = """\
[site]
id = "ecolar"
[sources.recording]
kind = "csv"
files = [{file}]
timestamp = {{ column = "{columns[0]}", format = "iso8601", zone = "{zone}" }}
[[zones]]
id = "living"
period = {period}
network = "{network}"
max_gap = 0
hold_inputs = "0s"
[zones.channels]
T_air = {{ source = "recording", column = "{columns[1]}", unit = "degC" }}
T_out = {{ source = "recording", column = "{columns[2]}", unit = "degC" }}
T_adj = {{ source = "recording", column = "{columns[3]}", unit = "degC" }}
u_heat = {{ source = "recording", columns = [{heaters}], unit = "kW", aggregate = "first", valid = [0, 20000] }}
"""
"""Preprocessing of paper 4.3.1: an interval that lacks a channel is dropped, nothing is bridged."""


class Contender(NamedTuple):
    """An online estimator in the comparison."""

    label: str
    estimator: str
    options: Mapping[str, object]


_NOISE: Mapping[str, object] = {"measurement_sd": MEASUREMENT_SD}
CONTENDERS = (
    Contender("RBPF default", "rbpf", _NOISE),
    Contender("RBPF paper", "rbpf", {"preset": "paper"}),
    Contender("EKF default", "ekf", _NOISE),
    Contender("EKF paper", "ekf", {"preset": "paper"}),
    Contender("UKF default", "ukf", _NOISE),
    Contender("UKF paper", "ukf", {"preset": "paper"}),
)


class Ecolar:
    """The experiment, made ready: its periods are read."""

    def __init__(self, request: Request) -> None:
        request.accept("data", "seeds", "days", "particles", "network", "config", "zone", "overrides")
        self._request = request
        self._network: Network = network_of(request, NETWORK).validate()
        needed = preset(NETWORK).channels
        if self._network.channels != needed:
            raise ReplayError(
                f"network '{self._network.name}' does not fit the recording; it needs the channels {', '.join(needed)}"
            )
        self._seeds = request.seeds_or(SEEDS)
        with tempfile.TemporaryDirectory(prefix="thermogate-ecolar-") as directory:
            self._periods = dict(_read(request, Path(directory)))

    def jobs(self) -> list[Job]:
        """Period by period and seed by seed: every contender, then the fit."""
        return [job for name in self._periods for seed in self._seeds for job in self._jobs(name, seed)]

    def _jobs(self, name: str, seed: int) -> list[Job]:
        series, found = self._periods[name], []
        for contender in CONTENDERS:
            options = dict(contender.options)
            if contender.estimator == "rbpf" and self._request.particles is not None:
                options["particles"] = self._request.particles
            run = FilterRun(contender.estimator, options, self._network, PERIOD, series, seed)
            found.append(night_job(f"{name} {contender.label}", NightRun(run, series, ZONE, MEASUREMENT_SD)))
        fit = LeastSquaresRun(self._network, PERIOD, segments_of(series, _SHORTEST_SEGMENT), _STARTS, seed)
        return [*found, night_job(f"{name} {LEAST_SQUARES}", NightRun(fit, series, ZONE, MEASUREMENT_SD))]

    def report(self, results: Sequence[Arrays]) -> Report:
        """Tables 7 and 8, figures 8 and 9."""
        rest = iter(results)
        outcomes = []
        for name, series in self._periods.items():
            runs: dict[str, list[Run]] = {contender.label: [] for contender in CONTENDERS}
            fits = []
            for _ in self._seeds:
                for contender in CONTENDERS:
                    arrays = next(rest)
                    trace = Trace(**{field: arrays[field] for field in Trace._fields})
                    runs[contender.label].append(Run(trace, arrays["nights_final"], arrays["nights_evening"]))
                fits.append(next(rest))
            outcomes.append(
                PeriodOutcome(
                    name,
                    series,
                    runs,
                    [fit["nights_final"] for fit in fits],
                    tuple(np.unique(np.concatenate([fit["at_bound"] for fit in fits])).tolist()),
                )
            )
        return report(self._network, self._request, self._seeds, outcomes)


def prepare(request: Request) -> Ecolar:
    """The experiment for `request`; ReplayError, ServiceError or ConfigError where it cannot be made."""
    return Ecolar(request)


def _read(request: Request, folder: Path) -> list[tuple[str, Series]]:
    """Each period's name and samples: the files of --data, otherwise stand-ins that are written for the purpose."""
    files = [(name, path.resolve()) for name, path in zip(names_of(request.data), request.data, strict=True)]
    if not files:
        files = [
            (name, write_standin(folder / f"ecolar-{name}-SYNTHETIC.csv", name))
            for name in steps(PERIODS, "simulating")
        ]
    read = []
    for name, path in steps(files, "reading"):
        config = configuration(path, folder)
        read.append((name, series_of(config, config.zones[0], request.days)))
    return read


def configuration(log: Path, folder: Path) -> Config:
    """The configuration of one zone that `log`, in Ecolar's raw layout, feeds; `folder` is for the file it takes."""
    text = _CONFIGURATION.format(
        file=_quoted(str(log)),
        columns=COLUMNS,
        zone=ZONE,
        period=PERIOD,
        network=NETWORK,
        heaters=", ".join(map(_quoted, HEATER_COLUMNS)),
    )
    path = folder / "ecolar.toml"
    path.write_text(text, encoding="utf-8")
    return load(path)


def _quoted(text: str) -> str:
    return "'" + text + "'" if '"' in text or "\\" in text else f'"{text}"'
