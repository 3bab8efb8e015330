"""The bank: members that trust different things, mixed for every horizon by what they have proved to be worth.

A model of a building is never true: what tracks best over one step drifts over a day, and what simulates a day best is
poor over one step. So each member keeps its own settings, and the bank, itself an estimator, learns which of them to
trust at which horizon (`estimator.bank.weights`). The spread that it publishes is scaled, horizon by horizon, so that
its interval covers as often as it claims (adaptive conformal inference, Gibbs and Candes 2021).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri

from estimator.arrays import Array
from estimator.bank.options import BankOptions
from estimator.bank.weights import Losses, between, no_losses, weights, with_loss
from estimator.kernels.quantiles import mixture_quantiles
from estimator.network.network import Network
from estimator.types import Estimator, Mixture, Outcome, ParameterSummary, Posterior
from estimator.verification.hindsight import Hindsight, Pending
from estimator.verification.scores import crps, reduced

COMPONENTS = 96
"""Components that a member brings into a mixture at most."""

_LOST = 6
"""Samples in a row that a member could not explain, after which it starts its temperatures anew."""

_WIDEST = 5.0
"""Bound of the log of the published spread over that of the mixture."""


class BankState(NamedTuple):
    """E members and H horizons."""

    members: tuple[Any, ...]
    pending: Pending
    losses: Losses
    log_scale: Array
    """(H,): log of the published spread over that of the mixture."""
    lost: Array
    """(E,): samples in a row that each member could not explain."""
    phase: Array
    """(): which steps issue the forecasts that are verified."""


class Bank:
    """The bank of one zone. See `estimator.types.Estimator` for the moves."""

    physical = True

    def __init__(self, network: Network, period: float, options: BankOptions, members: Mapping[str, Estimator]) -> None:
        self.network = network.validate()
        self.period = period
        self.options = options
        self.names = tuple(members)
        self.members = tuple(members.values())
        self._voice = self.names.index(options.voice)
        self.blocks = self.members[self._voice].blocks
        self._hindsight = Hindsight(self.members, period)
        self.leads = (1, *self._hindsight.leads)
        """Steps ahead of the horizons at which weights and scales are learned."""
        self._hours = period / 3600.0
        self._reach = float(ndtri(0.5 + options.coverage / 2.0))

    @property
    def issue_type(self) -> type[BankState]:
        """The state: a bank is no member of a bank, and verifies its forecasts itself."""
        return BankState

    def start(self, seed: int, outputs: Array, inputs: Array) -> BankState:
        """Every member at the first sample: its outputs (n_y,) and inputs (n_u,)."""
        members = tuple(member.start(seed, outputs, inputs) for member in self.members)
        horizons = len(self.leads)
        return BankState(
            members=members,
            pending=self._hindsight.start(len(inputs)),
            losses=no_losses(len(members), horizons),
            log_scale=np.zeros(horizons),
            lost=np.zeros(len(members)),
            phase=np.array(seed % 3600, dtype=np.int64),
        )

    def restart(self, state: BankState, outputs: Array, inputs: Array) -> BankState:
        """The first sample after a gap: the members' temperatures anew; what was learned of them is kept."""
        members = tuple(
            member.restart(own, outputs, inputs) for member, own in zip(self.members, state.members, strict=True)
        )
        return state._replace(members=members, pending=self._hindsight.start(len(inputs)), lost=np.zeros(len(members)))

    def predict(self, state: BankState, inputs: Array) -> BankState:
        """One period on under `inputs` (n_u,) held over the step."""
        members = tuple(member.predict(own, inputs) for member, own in zip(self.members, state.members, strict=True))
        pending = self._hindsight.advance(state.pending, inputs, members, int(state.phase))
        return state._replace(members=members, pending=pending)

    def predictive(self, state: BankState) -> Mixture:
        """The members' distributions of the outputs (n_y,), weighted and scaled for one step."""
        parts = [member.predictive(own) for member, own in zip(self.members, state.members, strict=True)]
        return self._mixed(state, parts, 1)

    def quantiles(self, mixture: Mixture, levels: Array, output: int) -> Array:
        """Quantiles (L,) of one output, by root-finding on the mixture CDF."""
        found: Array = mixture_quantiles(
            levels, ndtri(levels), mixture.weights, mixture.means[output], mixture.sds[output]
        )
        return found

    def update(self, state: BankState, outputs: Array) -> Posterior:
        """Let every member learn from `outputs` (n_y,), and the bank from what they had forecast for it."""
        posteriors = [member.update(own, outputs) for member, own in zip(self.members, state.members, strict=True)]
        vanished = np.array([posterior.outcome is Outcome.VANISHED for posterior in posteriors])
        state = (
            state._replace(
                members=tuple(posterior.state for posterior in posteriors),
                lost=np.where(vanished, state.lost + 1.0, 0.0),
            )
            if vanished.all()
            else self._learned(state, posteriors, vanished, outputs)
        )
        now = weights(state.losses, self.options)
        best = self._physical(now)
        return posteriors[self._voice]._replace(
            state=state,
            outcome=next((p.outcome for p in posteriors if p.outcome is not Outcome.VANISHED), Outcome.VANISHED),
            log_likelihood=_mixed_likelihood(now[:, 0], posteriors),
            parameters=self._own_parameters(best, posteriors[best].parameters),
            disturbance=next((p.disturbance for p in posteriors if p.disturbance is not None), None),
        )

    def forecast(self, state: BankState, plan: Array) -> Iterator[Mixture]:
        """The outputs at the state's time and then after each row of `plan` (h, n_u): h + 1 mixtures."""
        futures = [member.forecast(own, plan) for member, own in zip(self.members, state.members, strict=True)]
        for lead, parts in enumerate(zip(*futures, strict=True), start=1):
            yield self._mixed(state, parts, lead)

    def parameters(self, state: BankState, levels: Array) -> ParameterSummary:
        """Those of the physical member that is trusted most a few hours ahead."""
        best = self._physical(weights(state.losses, self.options))
        summary = self.members[best].parameters(state.members[best], levels)
        nodes = len(self.network.nodes)
        own = [
            summary.parameters[[p.name for p in self.members[best].network.parameters].index(p.name)]
            for p in self.network.parameters
        ]
        return summary._replace(parameters=np.array(own), time_constants=summary.time_constants[:nodes])

    def weights(self, state: BankState) -> Array:
        """(E, H): what every member weighs at each of `leads`."""
        return weights(state.losses, self.options)

    def issue(self, state: BankState, count: int) -> BankState:
        """The state itself."""
        return state

    def unfold(self, issue: BankState, plan: Array) -> Iterator[Mixture]:
        """What the issue forecasts under `plan` (h, n_u)."""
        return self.forecast(issue, plan)

    def verified(self, state: BankState, lead: int, errors: Array) -> BankState:
        """The state itself: the bank has seen its errors."""
        return state

    def pack(self, state: BankState) -> dict[str, Array]:
        """The arrays of a state, by name."""
        arrays = {"loss": state.losses.loss, "hours": state.losses.hours}
        arrays |= {"log_scale": state.log_scale, "lost": state.lost, "phase": state.phase}
        arrays |= {f"pending.{name}": value for name, value in self._hindsight.pack(state.pending).items()}
        for place, (member, own) in enumerate(zip(self.members, state.members, strict=True)):
            arrays |= {f"member.{place}.{name}": np.asarray(value) for name, value in member.pack(own).items()}
        return arrays

    def unpack(self, arrays: Mapping[str, Array]) -> BankState:
        """The state of packed arrays."""
        return BankState(
            members=tuple(
                member.unpack(_under(f"member.{place}.", arrays)) for place, member in enumerate(self.members)
            ),
            pending=self._hindsight.unpack(_under("pending.", arrays)),
            losses=Losses(arrays["loss"], arrays["hours"]),
            log_scale=arrays["log_scale"],
            lost=arrays["lost"],
            phase=arrays["phase"],
        )

    def _learned(self, state: BankState, posteriors: Sequence[Posterior], vanished: Array, outputs: Array) -> BankState:
        """The state after a sample that some members, with these posteriors, could explain."""
        members = [posterior.state for posterior in posteriors]
        lost = np.where(vanished, state.lost + 1.0, 0.0)
        losses, log_scale = state.losses, state.log_scale.copy()
        measured = np.flatnonzero(np.isfinite(outputs)).tolist()
        if measured:
            parts = [member.predictive(own) for member, own in zip(self.members, state.members, strict=True)]
            means, sds = np.array([part.mean() for part in parts]), np.array([part.sd() for part in parts])
            scores = np.mean([gaussian_crps(means[:, i], sds[:, i], outputs[i]) for i in measured], axis=0)
            log_scale[0] = self._kept(log_scale[0], self._mixed(state, parts, 1), outputs)
            losses = with_loss(losses, 0, scores, self._hours, self.options)
            for due in self._hindsight.due(state.pending):
                place = due.horizon + 1
                log_scale[place] = self._kept(log_scale[place], self._mixed(state, due.mixtures, due.lead), outputs)
                scores = np.array([np.mean([crps(part, i, outputs[i]) for i in measured]) for part in due.mixtures])
                losses = with_loss(losses, place, scores, 1.0, self.options)
                for index, (member, part) in enumerate(zip(self.members, due.mixtures, strict=True)):
                    members[index] = member.verified(members[index], due.lead, outputs - part.mean())
        for index in np.flatnonzero(lost >= _LOST).tolist():
            if len(state.pending.inputs):
                members[index] = self.members[index].restart(members[index], outputs, state.pending.inputs[-1])
                lost[index] = 0.0
        return state._replace(members=tuple(members), lost=lost, losses=losses, log_scale=log_scale)

    def _kept(self, log_scale: float, mixture: Mixture, outputs: Array) -> float:
        """The log scale after a verified forecast: up where the published interval missed, down where it did not."""
        tail = 0.5 - self.options.coverage / 2.0
        for i in np.flatnonzero(np.isfinite(outputs)).tolist():
            lower, upper = self.quantiles(mixture, np.array([tail, 1.0 - tail]), i)
            missed = float(not lower <= outputs[i] <= upper)
            log_scale += self.options.feedback * (missed - (1.0 - self.options.coverage))
        return min(max(log_scale, -_WIDEST), _WIDEST)

    def _mixed(self, state: BankState, parts: Sequence[Mixture], lead: int) -> Mixture:
        """The weighted mixture of the members' `parts` for `lead` steps ahead, scaled about its mean."""
        shares = between(weights(state.losses, self.options), self.leads, lead)
        scale = float(np.exp(between(state.log_scale, self.leads, lead)))
        small = [reduced(part, COMPONENTS) for part in parts]
        mixture = Mixture(
            np.concatenate(
                [share * part.weights / part.weights.sum() for share, part in zip(shares, small, strict=True)]
            ),
            np.concatenate([part.means for part in small], axis=1),
            np.concatenate([np.broadcast_to(part.sds, part.means.shape) for part in small], axis=1),
        )
        centre = mixture.mean()[:, None]
        return mixture._replace(means=centre + scale * (mixture.means - centre), sds=scale * mixture.sds)

    def _physical(self, now: Array) -> int:
        """The member with parameters of a building that is trusted most a few hours ahead."""
        horizon = min(2, now.shape[1] - 1)
        physical = [place for place, member in enumerate(self.members) if getattr(member, "physical", True)]
        return max(physical or range(len(self.members)), key=lambda place: now[place, horizon])

    def _own_parameters(self, member: int, theta: Array) -> Array:
        """The entries of `theta`, of a member's network, that the bank's own network has."""
        names = [parameter.name for parameter in self.members[member].network.parameters]
        return np.array([theta[names.index(parameter.name)] for parameter in self.network.parameters])


def _under(prefix: str, arrays: Mapping[str, Array]) -> dict[str, Array]:
    return {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}


def _mixed_likelihood(shares: Array, posteriors: Sequence[Posterior]) -> float:
    """log p(y_k | y_1:k-1) of the members' mixture; NaN where nothing was assimilated."""
    likelihoods = np.array([posterior.log_likelihood for posterior in posteriors])
    known = np.isfinite(likelihoods) & (shares > 0.0)
    if not known.any():
        return float("nan")
    return float(np.logaddexp.reduce(likelihoods[known] + np.log(shares[known])))
