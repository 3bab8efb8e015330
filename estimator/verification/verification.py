"""A zone's forecasts held to what came: one step, 1 h, 6 h and 24 h ahead, beside persistence and an ARX model.

One step is what was published, at every sample. Hours ahead it is a forecast that is issued every hour and unfolded,
when its time has come, under the inputs that really followed (`estimator.verification.hindsight`).
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from estimator.arrays import Array, together, under
from estimator.blackbox import options as blackbox_options
from estimator.blackbox.arx import ARX
from estimator.types import Estimator, Mixture, Outcome, Posterior
from estimator.verification.hindsight import Hindsight, Pending
from estimator.verification.one_step import OneStep
from estimator.verification.scores import crps, gaussian_crps
from estimator.verification.skill import Scores, SkillBook, empty_book, noted, scores, worth

LEVEL = 0.95
"""Of the interval whose coverage is counted."""

TAILS = np.array([0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0])
_BOOK, _PENDING, _ARX = "book.", "pending.", "arx."


class Verified(NamedTuple):
    """What a zone knows of its own forecasts between two samples."""

    pending: Pending
    arx: Any
    outputs: Array
    """(m, n_y): the first output of the last m samples [degC], newest last."""
    book: SkillBook


class Verification:
    """Verifies the forecasts of `estimator`. Every method is pure."""

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        measured = estimator.network.without_terms()
        self._arx = ARX(measured, estimator.period, blackbox_options.resolve(measured, estimator.period, {}))
        # A bank verifies the forecasts of its members, and hands on what they amount to.
        members = [self._arx] if estimator.verifies_itself else [estimator, self._arx]
        self._hindsight = Hindsight(estimator.network, members, estimator.period)
        self._measured = estimator.network.columns(measured)
        """What of a drive row is measured: the ARX model knows no terms."""
        self._leads = (1, *self._hindsight.leads)
        """Steps ahead of the horizons of the book."""
        self._shown = [place for place, lead in enumerate(self._leads) if place == 0 or lead > 1]
        """Those places of it that are shown: an hour that is no longer than one step is that step."""
        self.leads = tuple(round(self._leads[place] * estimator.period) for place in self._shown)
        """Of the horizons that are shown, from the last sample known to the one forecast [s]."""

    def start(self, seed: int, outputs: Array, inputs: Array) -> Verified:
        """Before the first forecast: outputs (n_y,) and inputs (n_u,) of the first sample."""
        return Verified(
            pending=self._hindsight.start(),
            arx=self._settled(self._arx.start(seed, outputs, inputs[self._measured])),
            outputs=outputs[None],
            book=empty_book(len(self._leads)),
        )

    def restart(self, verified: Verified, outputs: Array, inputs: Array) -> Verified:
        """The first sample after a gap: what was pending has lost its time, what was verified is kept."""
        return verified._replace(
            pending=self._hindsight.start(),
            arx=self._settled(self._arx.restart(verified.arx, outputs, inputs[self._measured])),
            outputs=outputs[None],
        )

    def update(
        self, verified: Verified, published: OneStep, posterior: Posterior, outputs: Array, time: int
    ) -> tuple[Verified, Any]:
        """After the sample at `time` [UTC s] with `outputs` (n_y,), for which `published` was the forecast.

        Also the state of `posterior`, told of the errors of the forecasts whose time has come. A sample that the
        estimator refused is none of its errors.
        """
        hour, y = time // 3600, float(outputs[0])
        book, arx, state = verified.book, verified.arx, posterior.state
        if np.isfinite(y):
            book = noted(book, hour, 0, self._one_step(published, arx, verified.outputs, y))
            due = tuple(self._hindsight.due(verified.pending))
            own = {one.lead: one.mixture for one in posterior.verified}
            if not self._estimator.verifies_itself:
                own = {one.lead: one.mixtures[0] for one in due}
                if posterior.outcome is not Outcome.VANISHED:
                    for lead, mixture in own.items():
                        state = self._estimator.verified(state, lead, outputs - mixture.mean())
            for one in due:
                last = verified.outputs[len(verified.outputs) - one.lead] if one.lead <= len(verified.outputs) else None
                reference = one.mixtures[-1]
                if one.lead in own and last is not None and np.isfinite(last[0]):
                    values = self._values(own[one.lead], y, float(last[0]), float(reference.mean()[0]))
                    book = noted(book, hour, one.horizon + 1, values)
                arx = self._arx.verified(arx, one.lead, outputs - reference.mean())
        arx = self._reference(arx, outputs, verified.outputs[-1])
        kept = np.concatenate([verified.outputs, outputs[None]])[-max(self._leads) :]
        return verified._replace(arx=arx, outputs=kept, book=book), state

    def predict(self, verified: Verified, state: Any, inputs: Array, seed: int) -> Verified:
        """One period on under `inputs` (n_u,), to which the estimator has predicted its `state`."""
        arx = self._arx.predict(verified.arx, inputs[self._measured])
        states = [arx] if self._estimator.verifies_itself else [state, arx]
        pending = self._hindsight.advance(verified.pending, inputs, states, seed % 3600)
        return verified._replace(arx=arx, pending=pending)

    def scores(self, verified: Verified, time: int, days: int) -> Scores:
        """What the forecasts of the last `days` days up to the sample at `time` [UTC s] were worth, in arrays (H,)
        beside `leads`."""
        found = scores(Scores, verified.book, time // 3600, 24 * days)
        return Scores(*(values[self._shown] for values in found))

    def pack(self, verified: Verified) -> dict[str, Array]:
        """Everything as arrays, by name."""
        pending, arx = self._hindsight.pack(verified.pending), self._arx.pack(verified.arx)
        parts = {_PENDING: pending, _ARX: arx, _BOOK: verified.book._asdict()}
        return together(parts) | {"outputs": verified.outputs}

    def unpack(self, arrays: Mapping[str, Array]) -> Verified:
        """What was packed, with the same bits."""
        return Verified(
            pending=self._hindsight.unpack(under(_PENDING, arrays)),
            arx=self._arx.unpack(under(_ARX, arrays)),
            outputs=arrays["outputs"],
            book=SkillBook(**under(_BOOK, arrays)),
        )

    def _reference(self, arx: Any, outputs: Array, last: Array) -> Any:
        """The ARX model after a sample. What is too far off it refuses, as one wrong reading; a level that stays, after
        `last`, is the new one."""
        posterior = self._arx.update(arx, outputs)
        if posterior.outcome is not Outcome.VANISHED:
            return posterior.state
        stays = np.abs(outputs - last) < 0.5 * np.abs(outputs - self._arx.predictive(arx).mean())
        return self._settled(self._arx.restart(arx, outputs, arx.inputs[0])) if stays.any() else posterior.state

    def _settled(self, arx: Any) -> Any:
        """The ARX model at its first sample, which has nothing more to teach."""
        return self._arx.update(arx, np.full(len(self._estimator.network.measured), np.nan)).state

    def _one_step(self, published: OneStep, arx: Any, outputs: Array, y: float) -> tuple[float, ...]:
        """What the published forecast of `y` was worth, by Scores without the number."""
        mean, sd = float(published.mean[0]), float(published.sd[0])
        interval = published.interval(LEVEL, 0) or (mean - 1.96 * sd, mean + 1.96 * sd)
        reference, last = float(self._arx.predictive(arx).mean()[0]), float(outputs[-1, 0])
        cost = float(gaussian_crps(published.mean[:1], published.sd[:1], y)[0])
        return worth(y, mean, cost, interval, last if np.isfinite(last) else reference, reference)

    def _values(self, mixture: Mixture, y: float, last: float, reference: float) -> tuple[float, ...]:
        """What `mixture` was worth as a forecast of `y`, by Scores without the number."""
        interval = mixture.quantiles(TAILS, 0).tolist()
        return worth(y, float(mixture.mean()[0]), crps(mixture, 0, y), interval, last, reference)
