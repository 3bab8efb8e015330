"""The daemon's worker over samples, and the table of numbers that its updates leave."""

from collections.abc import Sequence
from math import nan
from typing import Self

import numpy as np

from estimator.arrays import Array
from estimator.types import Outcome
from replay.recorded.trace import Tracer
from service.config.fitting import fingerprint, make_worker, taught
from service.records.sample import Sample
from service.records.update import CONSTANT, Update
from service.zone.worker import STARTED
from thermogate.settings import Settings

OUTCOMES = (STARTED, *map(str, Outcome))
REGIMES = (CONSTANT, "low", "transitional", "high")
"""What the numbers under "outcome" and "regime" stand for."""
SCORED = ("mean", "sd", "lower", "upper", "residual")
ALPHA = ("lower", "median", "upper", "cdf")
BOUNDS = ("lower", "median", "upper")


class Session:
    """One zone on its way through samples."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.worker = make_worker(settings.zone)
        self.names = self._names()
        self._rows: list[list[float]] = []
        self.tracer = Tracer(settings.zone, self.worker)
        """What a report needs of them."""

    def begin(self, others: Sequence[Self]) -> None:
        """Begin with what `others` have learned; before the first sample."""
        experience = taught(self.worker, [other.worker for other in others])
        self.worker.carried = self.worker.carried._replace(experience=experience)

    def take(self, sample: Sample) -> None:
        update = self.worker.step(sample)
        if update is not None:
            self._rows.append(self._row(update))
            self.tracer.note(update)

    def __len__(self) -> int:
        """How many samples could be used."""
        return self.worker.progress.samples

    @property
    def updates(self) -> Array:
        """(K, len(names)): one row for every sample that could be used."""
        return np.array(self._rows, dtype=np.float64).reshape(len(self._rows), len(self.names))

    @updates.setter
    def updates(self, rows: Array) -> None:
        self._rows = rows.tolist()

    def span(self) -> tuple[float, float]:
        """Times of the first that is known and of the last of them, UTC seconds."""
        latest = self.worker.latest
        assert latest is not None
        known = [*(row.time for row in self.tracer.rows[:1]), *(row[0] for row in self._rows[:1])]
        return float(min(known, default=latest.time)), float(latest.time)

    def columns(self) -> dict[str, Array]:
        """The updates as columns (K,) by name."""
        return dict(zip(self.names, self.updates.T, strict=True))

    @property
    def mark(self) -> str:
        """What a stored state belongs to."""
        return fingerprint(self.settings.zone)

    def _names(self) -> tuple[str, ...]:
        estimator = self.worker.estimator
        network = estimator.network
        return (
            *("time", "outcome", "segment", "log_likelihood", "gate", "regime", "n_eff", "resampled"),
            *(f"{quantity}.{output}" for output in network.measured for quantity in ("y", *SCORED)),
            *(f"alpha.{quantity}.{block}" for block in estimator.blocks for quantity in ALPHA),
            *(f"theta.{parameter.name}" for parameter in network.parameters),
            *(f"gain.{bound}" for bound in BOUNDS),
            "gain.probability_on",
            *(f"sd.{bound}.{output}" for output in network.measured for bound in BOUNDS),
        )

    def _row(self, update: Update) -> list[float]:
        gate, score, alpha, gain = update.shown_gate, update.score, update.volatility, update.disturbance
        row = [update.time, OUTCOMES.index(update.outcome), update.segment, update.log_likelihood]
        row += [gate.value, REGIMES.index(gate.regime), update.shown_sample_size, update.resampled]
        for i, y in enumerate(update.y):
            row += [y, *(nan if score is None else getattr(score, quantity)[i] for quantity in SCORED)]
        for values in zip(alpha.lower, alpha.median, alpha.upper, alpha.cdf, strict=True):
            row += values
        row += update.parameters
        if gain is None:
            row += [nan] * (len(self.names) - len(row))
        else:
            row += [*gain.gain, gain.probability_on, *(sd for bounds in gain.measurement_sd for sd in bounds)]
        return list(map(float, row))
