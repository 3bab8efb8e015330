"""The daemon's worker over samples, and its forecasts held to what came."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from estimator import registry
from estimator.arrays import Array
from estimator.types import Mixture, Outcome
from estimator.verification.hindsight import HORIZONS, Hindsight
from estimator.verification.scores import crps
from service.config.fitting import fingerprint, make_worker
from service.records.sample import Sample
from service.records.update import Update
from service.store.checkpoint import Checkpoint
from service.zone import snapshot
from service.zone.worker import STARTED, Standing, ZoneWorker
from thermogate.rows import Rows
from thermogate.settings import Settings

OUTCOMES = (STARTED, *map(str, Outcome))
REGIMES = ("constant", "low", "transitional", "high")
"""What the numbers under "outcome" and "regime" stand for."""

ARX = "arx"
ONE_STEP = 0
"""The horizon of one step; horizon i + 1 is HORIZONS[i]."""

VERIFIED = (
    *("time", "horizon", "output", "y", "mean", "lower", "upper", "crps"),
    *("persistence_error", "arx_error", "arx_crps"),
)
"""A forecast that was held to `y` [degC] at `time`; errors are measurement minus forecast [K]."""


class Session:
    """One zone on its way through samples."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.worker = make_worker(settings.zone)
        network, period = self.worker.network, settings.zone.period
        self._companion = ZoneWorker(registry.build(ARX, network, period, {}), self.worker.settings)
        self._members = (self.worker, self._companion)
        self._hindsight = Hindsight([member.estimator for member in self._members], period)
        self._width = len(network.inputs)
        self._pending = self._hindsight.start(self._width)
        self._leads = (1, *self._hindsight.leads)
        self._past = np.full((max(self._leads), len(network.measured)), np.nan)
        """(m, n_y): the last m measurements, the newest last."""
        self.updates = Rows(self._update_names())
        self.verified = Rows(VERIFIED)

    def take(self, sample: Sample) -> None:
        """One sample on."""
        standing = [member.standing for member in self._members]
        before = [
            None if one is None else member.estimator.predictive(one.state) for member, one in self._both(standing)
        ]
        update, _ = (member.step(sample) for member in self._members)
        if update is None:
            self._pending = self._hindsight.start(self._width)
            self._remember(sample.outputs)
            return
        scores = np.full(len(sample.outputs), np.nan)
        if update.score is not None and before[0] is not None and before[1] is not None:
            for i in np.flatnonzero(np.isfinite(sample.outputs)).tolist():
                scores[i] = crps(before[0], i, sample.outputs[i])
                bounds = update.score.lower[i], update.score.upper[i]
                self._judge(sample, i, ONE_STEP, (before[0], before[1]), bounds, scores[i])
        if update.outcome == STARTED:
            self._pending = self._hindsight.start(self._width)
        else:
            self._verify(sample)
        self.updates.add(self._row(update, scores))
        self._remember(sample.outputs)
        states = [member.standing.state for member in self._members if member.standing is not None]
        self._pending = self._hindsight.advance(self._pending, self.worker.held.values, states, 0)

    def pack(self) -> tuple[dict[str, Array], dict[str, Any]]:
        """Everything as arrays by name, and as what JSON holds."""
        arrays = {"updates": self.updates.array(), "verified": self.verified.array(), "past": self._past}
        arrays |= {f"pending.{name}": value for name, value in self._hindsight.pack(self._pending).items()}
        metas: dict[str, Any] = {}
        for name, member in zip(("own", ARX), self._members, strict=True):
            taken = snapshot.take(member, self.mark, name)
            assert taken is not None, "a model is saved after its first update"
            arrays |= {f"{name}.{key}": value for key, value in taken.arrays.items()}
            metas[name] = taken.meta
        return arrays, metas

    def unpack(self, arrays: Mapping[str, Array], metas: Mapping[str, Any]) -> None:
        """Go on where another session of the same settings was packed."""
        self.updates = Rows(self.updates.names, arrays["updates"])
        self.verified = Rows(VERIFIED, arrays["verified"])
        self._past = arrays["past"]
        self._pending = self._hindsight.unpack(_under("pending.", arrays))
        for name, member in zip(("own", ARX), self._members, strict=True):
            snapshot.restore(member, Checkpoint(self.mark, 0, _under(f"{name}.", arrays), metas[name]))

    @property
    def mark(self) -> str:
        """What a stored state belongs to."""
        return fingerprint(self.settings.zone)

    def _both(self, standing: list[Standing | None]) -> list[tuple[ZoneWorker, Standing | None]]:
        return list(zip(self._members, standing, strict=True))

    def _verify(self, sample: Sample) -> None:
        """Score the forecasts of hours ahead whose time has come, and tell the members of their errors."""
        levels = np.array([0.5 - self._level / 2, 0.5 + self._level / 2])
        for due in self._hindsight.due(self._pending):
            own, arx = due.mixtures
            for i in np.flatnonzero(np.isfinite(sample.outputs)).tolist():
                lower, upper = self.worker.estimator.quantiles(own, levels, i)
                score = crps(own, i, sample.outputs[i])
                self._judge(sample, i, due.horizon + 1, (own, arx), (lower, upper), score)
            for member, mixture in zip(self._members, due.mixtures, strict=True):
                standing = member.standing
                if standing is not None:
                    errors = sample.outputs - mixture.mean()
                    state = member.estimator.verified(standing.state, due.lead, errors)
                    member.resume(standing._replace(state=state), member.held, member.progress)

    def _judge(
        self,
        sample: Sample,
        output: int,
        horizon: int,
        mixtures: tuple[Mixture, Mixture],
        bounds: tuple[float, float],
        score: float,
    ) -> None:
        own, arx = mixtures
        y, persisted = sample.outputs[output], self._past[-self._leads[horizon], output]
        arx_error, arx_score = y - arx.mean()[output], crps(arx, output, y)
        own_mean = own.mean()[output]
        self.verified.add(
            [sample.time, horizon, output, y, own_mean, *bounds, score, y - persisted, arx_error, arx_score]
        )

    def _remember(self, outputs: Array) -> None:
        self._past = np.concatenate([self._past[1:], outputs[None]])

    @property
    def _level(self) -> float:
        return self.settings.zone.levels[0]

    def _update_names(self) -> list[str]:
        estimator = self.worker.estimator
        names = ["time", "outcome", "segment", "log_likelihood", "gate", "regime", "n_eff", "resampled", "floored"]
        quantities = ("y", "mean", "sd", "lower", "upper", "residual", "crps")
        names += [f"{quantity}.{output}" for output in estimator.network.measured for quantity in quantities]
        names += [f"alpha.{block}.{q}" for block in estimator.blocks for q in ("lower", "median", "upper", "cdf")]
        return names + [f"theta.{parameter.name}" for parameter in estimator.network.parameters]

    def _row(self, update: Update, scores: Array) -> list[float]:
        row = [update.time, OUTCOMES.index(update.outcome), update.segment, update.log_likelihood, update.gate.value]
        row += [REGIMES.index(update.gate.regime), update.effective_sample_size, update.resampled, update.floored]
        for i, y in enumerate(update.y):
            known = update.score
            if known is None:
                row += [y, *[np.nan] * 6]
            else:
                row += [y, known.mean[i], known.sd[i], known.lower[i], known.upper[i], known.residual[i], scores[i]]
        alpha = update.volatility
        for values in zip(alpha.lower, alpha.median, alpha.upper, alpha.cdf, strict=True):
            row += values
        return [*row, *update.parameters]


def horizon_names(period: float) -> dict[int, str]:
    """The horizons that are verified at a period [s]: one step, and what is longer than it."""
    hours = {place: round(seconds / 3600) for place, seconds in enumerate(HORIZONS, start=1)}
    return {ONE_STEP: "1 step"} | {
        place: f"{hours[place]}h" for place, seconds in enumerate(HORIZONS, start=1) if round(seconds / period) > 1
    }


def _under(prefix: str, arrays: Mapping[str, Array]) -> dict[str, Array]:
    return {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}
