"""The bank: members that trust different things, mixed for every horizon by what they have proved to be worth.

A model of a building is never true: what tracks best over one step drifts over a day, and what simulates a day best is
poor over one step. So each member keeps its own settings, and the bank, itself an estimator, learns which of them to
trust at which horizon (`estimator.bank.weights`) and how wide to make what it publishes (`estimator.bank.coverage`).

Who is best under the heat that followed may be wrong about any other heat. A thermostat heats more while a window is
open, so in its records much heat does not go with much warmth, and a member that takes all it cannot explain for noise
of the sensor learns that heating does little: the bias of output-error fits in closed loop (Forssell and Ljung,
"Closed-loop identification revisited", Automatica 35, 1999). It foresees well what the thermostat will bring about.
What another heating would do, and what is told of the building, is left to members whose model of the disturbances is
fit for that (`Member.plans`); the others tell under a plan what would follow the usual heating.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from estimator.arrays import DAY, HOUR, Array, Indices, Mask, together, under
from estimator.bank.coverage import Widths, no_widths, with_place
from estimator.bank.departures import as_usual, departure
from estimator.bank.mixing import mixed, mixed_futures, stretched
from estimator.bank.options import BankOptions, prior_at
from estimator.bank.residuals import Corrector, Residuals
from estimator.bank.weights import (
    NEGLIGIBLE,
    Costs,
    between,
    costs_of,
    counting,
    no_costs,
    weights,
    with_cost,
)
from estimator.blackbox.arx import ARX
from estimator.blackbox.direct import Direct
from estimator.network.assembly import assemble, topology
from estimator.network.discretise import heat_loss, time_constants
from estimator.network.network import Network
from estimator.particle.gate import weighted_quantiles
from estimator.types import (
    Disturbance,
    Estimator,
    Mixture,
    Mixtures,
    ModelDraws,
    OneState,
    Outcome,
    ParameterSummary,
    Posterior,
    Verified,
)
from estimator.verification.hindsight import Due, Hindsight, Issue, Pending
from estimator.verification.scores import distribution, reduced

_COMPONENTS = 48
"""Components that a member brings into the distribution of the next sample at most."""

_DRAWS = 400
"""Draws from a member for the quantiles of the parameters."""

_LOST = 6
"""Samples in a row that a member could not explain, after which it starts its temperatures anew."""

_UNDER_PLANS = 0.2
"""What of the evidence about members, which is all of the heat that followed, counts under other heat."""

_KNOWING = 0.6
"""Share of what is told of the building, at least, of members that know sun and habits: to the others, where people
live, the building changes from day to day."""

_COMPARED_AHEAD = 6 * HOUR
"""s: where a network shows, long enough for its slow paths and short enough to be learned in days."""


class BankState(NamedTuple):
    """E members and H horizons."""

    members: tuple[Any, ...]
    pending: Pending
    costs: Costs
    answers: Costs
    """The same of answers to plans of heating."""
    widths: Widths
    residuals: Residuals
    """Of the members that `plans` names."""
    lost: Array
    """(E,): samples in a row that each member could not explain."""
    phase: Array
    """(): which steps issue the forecasts that are verified."""
    departs: bool = False
    """Whether the heating to come is a plan, which departs from what is usual; of an issue, never stored."""


class _Drawn(NamedTuple):
    """K draws from one member, whose own network has n_x states."""

    weights: Array
    """(K,): they add up to the member's weight."""
    theta: Array
    """(n_theta, K): the parameters of the bank's network."""
    time_constants: Array
    """(n_x, K) in seconds, fastest first."""
    heat_loss: Array
    """(K,) in W/K."""
    coefficients: Array
    """(m, K): of the bank's terms; none where the member has not all of them."""


class Bank(OneState):
    """The bank of one zone. See `estimator.types.Estimator` for the moves."""

    state_type = BankState
    """Also what is issued: a bank is no member of a bank, and verifies its forecasts itself."""
    verifies_itself = True

    def __init__(self, network: Network, period: float, options: BankOptions, members: Mapping[str, Estimator]) -> None:
        self.network = network.validate()
        self.period = period
        self.options = options
        self.names = tuple(members)
        self.members = tuple(members.values())
        self.forecast_draws = options.scenarios
        self._voice = self.names.index(options.voice)
        physical = [member.physical for member in self.members]
        self.physical = any(physical)
        fit = [has and options.members[name].plans for name, has in zip(self.names, physical, strict=True)]
        self.plans = np.array(fit if any(fit) else physical)
        """(E,): whose physics is asked what a plan of heating would do, and is told of the building."""
        knowing = self.plans & np.array([bool(member.network.terms) for member in self.members])
        self._knowing = knowing if knowing.any() else self.plans
        """(E,): who of them knows sun and habits, where anyone does."""
        self.blocks = self.members[self._voice].blocks
        self._heat = [place for place, name in enumerate(network.inputs) if network.channel_unit(name) == "W"]
        self._usual = ~self.plans & self.plans.any() & bool(self._heat)
        """(E,): who tells the usual course, from which a plan departs."""
        self._columns = [self.network.columns(member.network) for member in self.members]
        """What of the bank's drive row drives every member's network."""
        self._day = max(1, round(DAY / period))
        before = self._day if self._usual.any() else 0
        self._hindsight = Hindsight(self.network, self.members, period, before)
        self.leads = (1, *(lead for lead in self._hindsight.leads if lead > 1))
        """Steps ahead of the horizons at which weights and widths are learned."""
        answering = np.flatnonzero(self.plans).tolist()
        self._corrector = Corrector(self.network, period, self.leads, answering)
        hours = self._ahead = np.array(self.leads) * period / HOUR
        """The leads in hours."""
        self._hours = np.where(np.arange(len(hours)) == 0, hours, self._hindsight.every * period / HOUR)
        """From one verified forecast to the next."""
        self._shares = np.minimum(self._hours / hours, 1.0)
        """Of a verified forecast, in forecasts that do not overlap."""
        self.compared = int(np.argmin(np.abs(np.array(self.leads) * period - _COMPARED_AHEAD)))
        """Place among `leads` of the horizon at which members are compared as models of the building."""
        own = [parameter.name for parameter in self.network.parameters]
        named = [[parameter.name for parameter in member.network.parameters] for member in self.members]
        self._entries = [[names.index(name) for name in own] for names in named]
        """Where the parameters of every member's network have those of the bank's."""
        self._prior = np.array([prior_at(member.prior, hours) for member in options.members.values()])
        self._newest: tuple[BankState | None, list[Mixture], Mixture | None] = None, [], None
        """A state, its members' forecasts and what is published of them, which are scored soon after."""

    def start(self, seed: int, outputs: Array, inputs: Array) -> BankState:
        """Every member at the first sample: its outputs (n_y,) and inputs (n_u,)."""
        members = tuple(
            member.start(seed, outputs, inputs[own]) for member, own in zip(self.members, self._columns, strict=True)
        )
        return BankState(
            members=members,
            pending=self._hindsight.start(),
            costs=no_costs(len(members), len(self.leads)),
            answers=no_costs(len(members), len(self.leads)),
            widths=no_widths(len(self.leads)),
            residuals=self._corrector.start(outputs),
            lost=np.zeros(len(members)),
            phase=np.array(seed % 3600, dtype=np.int64),
        )

    def restart(self, state: BankState, outputs: Array, inputs: Array) -> BankState:
        """The first sample after a gap: the members' temperatures anew; what was learned of them is kept."""
        members = tuple(
            member.restart(own, outputs, inputs[columns])
            for member, own, columns in zip(self.members, state.members, self._columns, strict=True)
        )
        pending, past = self._hindsight.start(), state.pending.inputs[-self._day :]
        if self._usual.any() and len(past):
            # Nobody tells how long the gap was, and so at which hours it was heated.
            pending = pending._replace(inputs=np.broadcast_to(past.mean(axis=0), (self._day, past.shape[1])))
        return state._replace(
            members=members,
            pending=pending,
            residuals=self._corrector.restart(state.residuals, outputs),
            lost=np.zeros(len(members)),
        )

    def predict(self, state: BankState, inputs: Array) -> BankState:
        """One period on under `inputs` (n_u,) held over the step."""
        members = tuple(
            member.predict(own, inputs[columns])
            for member, own, columns in zip(self.members, state.members, self._columns, strict=True)
        )

        def now() -> Array:
            return np.vstack([self._weights(state), np.exp(state.widths.log_scale), self._reaches(state)])

        pending = self._hindsight.advance(state.pending, inputs, members, int(state.phase), now)
        return state._replace(members=members, pending=pending, residuals=self._corrector.predict(state.residuals))

    def predictive(self, state: BankState) -> Mixture:
        """The members' distributions of the outputs (n_y,), weighted and scaled for one step."""
        return self._told(state)[1]

    def update(self, state: BankState, outputs: Array) -> Posterior:
        """Let every member learn from `outputs` (n_y,), and the bank from what they had forecast for it."""
        posteriors = [member.update(own, outputs) for member, own in zip(self.members, state.members, strict=True)]
        vanished = np.array([posterior.outcome is Outcome.VANISHED for posterior in posteriors])
        known = bool(np.isfinite(outputs).any()) and not vanished.all()
        told = tuple(self._hindsight.due(state.pending)) if known else ()
        believed = outputs if known else np.full_like(outputs, np.nan)
        residuals, due = self._corrector.judged(state.residuals, told, state.pending.inputs, believed)
        bounds = self._bounds(state) if due else None
        verified = tuple(Verified(one.lead, self._published(one, bounds)) for one in due)
        before = self._weights(state)
        after = self._learned(state, before, outputs, due, verified) if known else state
        after = after._replace(answers=self._judged(state, outputs, told, due))
        after = self._members_after(after._replace(residuals=residuals), posteriors, vanished, outputs, due)
        now = self._weights(after)
        best = self._most_trusted(now)
        return posteriors[self._voice]._replace(
            state=after,
            outcome=next((p.outcome for p in posteriors if p.outcome is not Outcome.VANISHED), Outcome.VANISHED),
            log_likelihood=_mixed_likelihood(before[:, 0], posteriors),
            parameters=posteriors[best].parameters[self._entries[best]],
            disturbance=self._disturbance(now, posteriors),
            verified=verified,
        )

    def parameters(self, state: BankState, levels: Array) -> ParameterSummary:
        """Quantiles over draws from all members that `plans` names, each with the weight that it has a few hours ahead;
        those that know sun and habits have _KNOWING together, if not more.

        Of a member with another network than the bank's, only the parameters that both have count. Its time constants
        count if it has as many nodes as the bank's network, for those of more nodes are others; where no member has as
        many, the fastest stand for them. Not a number where no member has physics.
        """
        if not self.plans.any():
            return self.members[0].parameters(state.members[0], levels)
        drawn, size = list(self._drawn(state)), len(self.network.nodes)
        weights = np.concatenate([each.weights for each in drawn])
        theta = np.concatenate([each.theta for each in drawn], axis=1)
        alike = [each for each in drawn if len(each.time_constants) == size] or drawn
        shares = np.concatenate([each.weights for each in alike])
        constants = np.concatenate([each.time_constants[:size] for each in alike], axis=1)
        return ParameterSummary(
            levels=levels,
            parameters=np.array([weighted_quantiles(row, weights, levels) for row in theta]),
            time_constants=np.array([weighted_quantiles(row, shares, levels) for row in constants]),
            heat_loss=weighted_quantiles(np.concatenate([each.heat_loss for each in drawn]), weights, levels),
            coefficients=self._coefficients([each for each in drawn if len(each.coefficients)], levels),
        )

    def _coefficients(self, drawn: Sequence[_Drawn], levels: Array) -> Array:
        """(m, n_levels): quantiles of the coefficients over the draws from members that have them; (0, 0) without
        one."""
        if not drawn:
            return np.empty((0, 0))
        weights = np.concatenate([each.weights for each in drawn])
        rows = np.concatenate([each.coefficients for each in drawn], axis=1)
        return np.array([weighted_quantiles(row, weights, levels) for row in rows])

    def _drawn(self, state: BankState) -> Iterator[_Drawn]:
        """Draws from every member that `plans` names and that counts."""
        weights = self._weights(state)
        now, best = np.where(self.plans, weights[:, self.compared], 0.0), self._most_trusted(weights)
        knowing, others = now[self._knowing].sum(), now[~self._knowing].sum()
        if 0.0 < knowing * (1.0 - _KNOWING) < others * _KNOWING and not state.lost[self._knowing].all():
            now = np.where(self._knowing, now * (others * _KNOWING / (knowing * (1.0 - _KNOWING))), now)
        for place, (member, own) in enumerate(zip(self.members, state.members, strict=True)):
            if self.plans[place] and (now[place] >= NEGLIGIBLE or place == best):
                drawn = member.draws(own, _DRAWS)
                assert drawn is not None
                matrices = assemble(member.network, drawn.theta)
                yield _Drawn(
                    weights=now[place] * drawn.weights,
                    theta=drawn.theta[self._entries[place]],
                    time_constants=time_constants(matrices).T,
                    heat_loss=heat_loss(matrices, int(topology(member.network).measured[0])),
                    coefficients=drawn.coefficients,
                )

    def member_weights(self, state: BankState) -> Mapping[str, Array]:
        """What each member weighs at each of `leads`, (H,) by name."""
        return dict(zip(self.names, self._weights(state), strict=True))

    def earned_weights(self, state: BankState) -> Mapping[str, Array]:
        """What each member would weigh at each of `leads` had all begun alike, (H,) by name: what it has proved."""
        alike = np.ones_like(self._prior)
        found = weights(state.costs, alike, self.options.learning_rate, self.options.sharing)
        return dict(zip(self.names, found, strict=True))

    def unfold(self, issue: BankState, plan: Array) -> Mixtures:
        """The outputs at the issue's time and after each row of `plan` (h, n_u)."""
        now = self.predictive(issue)
        if not len(plan):
            return Mixtures.of_one(now)
        return self.futures(issue, plan, np.arange(1, len(plan) + 1)).after(now)

    def futures(self, state: BankState, plan: Array, after: Indices) -> Mixtures:
        """The mixtures of the members' futures after so many rows (L,) of `plan` (h, n_u), at least one."""
        steps, leads = np.arange(2, len(plan) + 2, dtype=np.float64), np.asarray(after + 1.0)
        shares = between(self._weights(state), self.leads, steps)
        counts = counting(shares)
        departs = state.departs and bool(counts[self._usual].any())
        if departs:
            knowing = between(self._weights(state, self.plans), self.leads, steps)
            counts = counts | counting(knowing)
        chosen = np.flatnonzero(counts).tolist()
        issues = {place: self.members[place].issue(state.members[place], self.options.scenarios) for place in chosen}
        if departs:
            futures = self._unfolded({place: issues[place] for place in chosen if self.plans[place]}, plan, after)
            usual = self._unfolded(issues, self._as_usual(plan, state.pending.inputs), after)
            changed = departure(futures, usual, knowing[:, after - 1])
            futures = {place: futures.get(place) or changed.of(usual[place]) for place in chosen}
        else:
            futures = self._unfolded(issues, plan, after)
        corrections = self._corrector.corrections(state.residuals, plan, after)
        for place, by in zip(self._corrector.members, corrections, strict=True):
            if place in futures:
                futures[place] = futures[place]._replace(means=futures[place].means + by.T[..., None])
        shares = shares[chosen][:, after - 1]
        shares = shares / shares.sum(axis=0)
        scales, reaches = (between(row, self.leads, leads) for row in (state.widths.log_scale, self._reaches(state)))
        return mixed_futures(list(futures.values()), shares, np.exp(scales), reaches, self._bounds(state))

    def draws(self, state: BankState, count: int) -> ModelDraws | None:
        """Those of the member of `_knowing` that is trusted most a few hours ahead; None where nobody has physics."""
        now = self._weights(state)
        best = self._most_trusted(now)
        drawn = self.members[best].draws(state.members[best], count)
        if drawn is None:
            return None
        share = float(now[best, self.compared])
        if len(self.network.terms) > len(drawn.coefficients):
            # Models for the bank's drive rows, of which this one knows the measured inputs.
            drawn = drawn._replace(
                network=replace(drawn.network, terms=self.network.terms),
                coefficients=np.zeros((len(self.network.terms), drawn.theta.shape[1])),
            )
        # What the bank forecasts is the mixture of all members, which no single model simulates.
        return drawn._replace(member=self.names[best], share=share)

    def by_physics(self, state: BankState) -> BankState:
        """`state` as it answers by physics alone: members that `plans` does not name count as lost, evidence about the
        others for less, and nothing is told with more certainty than theirs."""
        if not self.plans.any():
            return state
        return state._replace(
            lost=np.where(self.plans, state.lost, np.inf),
            costs=state.costs._replace(excess=_UNDER_PLANS * state.costs.excess),
            widths=state.widths._replace(log_scale=np.maximum(state.widths.log_scale, 0.0)),
        )

    def answering_plan(self, state: BankState) -> BankState:
        """`state` as it answers a plan of heating: by physics, and by what the others say of the usual heating with
        what physics says the plan changes about it (`estimator.bank.departures`). Who is better is found by all the
        evidence: the effect of heat is the same."""
        asked = self.by_physics(state)
        if not self._usual.any() or not len(state.pending.inputs):
            return asked
        excess = np.hstack([state.costs.excess[:, :1], state.answers.excess[:, 1:]])
        forgiven = (1.0 - _UNDER_PLANS) * excess[self.plans].min(axis=0)
        excess = np.where(self.plans[:, None], _UNDER_PLANS * excess, excess - forgiven)
        return asked._replace(lost=state.lost, costs=state.costs._replace(excess=excess), departs=True)

    def _judged(self, state: BankState, outputs: Array, told: Sequence[Due], due: Sequence[Due]) -> Costs:
        """Costs of the answers to plans after a sample, had its heating been planned: `told` is what was issued for it,
        and `due` the same with its corrections."""
        costs, inputs = state.answers, state.pending.inputs
        if not told or not self._usual.any():
            return costs
        asked = self.answering_plan(state)
        now, knowing = self._weights(asked), self._weights(asked, self.plans)
        for issued, one in zip(told, due, strict=True):
            rest, horizon = one.lead - 1, self.leads.index(one.lead)
            # State of an earlier version knows too few inputs.
            if len(inputs) > rest:
                rows = self._as_usual(inputs[-rest:], inputs[:-rest])
                usual = self._unfolded(dict(enumerate(issued.samples)), rows, np.array([rest]))
                planned = {place: Mixtures.of_one(issued.mixtures[place]) for place in self._corrector.members}
                changed = departure(planned, usual, knowing[:, [horizon]])
                parts = [
                    mixture if self.plans[place] else changed.of(usual[place]).at(0)
                    for place, mixture in enumerate(one.mixtures)
                ]
                costs = self._charged(costs, horizon, parts, now, outputs)
        return costs

    def _unfolded(self, issues: Mapping[int, Any], rows: Array, after: Indices) -> dict[int, Mixtures]:
        """What members, by their places, forecast from their `issues` after so many (L,) of the bank's drive `rows`."""
        return {
            place: self.members[place].unfold(issue, rows[:, self._columns[place]]).during(after)
            for place, issue in issues.items()
        }

    def _as_usual(self, plan: Array, past: Array) -> Array:
        return as_usual(plan, past, self._heat, self._day, self._hindsight.every)

    def _charged(self, costs: Costs, horizon: int, parts: Sequence[Mixture], now: Array, outputs: Array) -> Costs:
        """`costs` after `outputs` (n_y,) came, of which `parts`, with weights `now` (E, H), had been forecast."""
        for i in np.flatnonzero(np.isfinite(outputs)).tolist():
            cost, total = costs_of(parts, now[:, horizon], i, outputs[i])
            if np.isfinite(cost).all():
                hours = float(self._hours[horizon]) / len(outputs)
                costs = with_cost(costs, horizon, cost, total, hours, self.options.discount)
        return costs

    @property
    def regresses(self) -> bool:
        """Whether a member forecasts hours ahead without asking for inputs to come."""
        return any(_blind(member) for member in self.members)

    def by_regression(self, state: BankState) -> BankState:
        """`state` as it answers where nobody knows the inputs to come: all members but these count as lost."""
        return state._replace(lost=np.where([_blind(member) for member in self.members], state.lost, np.inf))

    def pack(self, state: BankState) -> dict[str, Array]:
        """The arrays of a state, by name."""
        pending, members = self._hindsight.pack(state.pending), zip(self.members, state.members, strict=True)
        parts = {"costs.": state.costs._asdict(), "widths.": state.widths._asdict(), "pending.": pending}
        parts |= {"residuals.": state.residuals._asdict(), "answers.": state.answers._asdict()}
        parts |= {f"member.{place}.": member.pack(own) for place, (member, own) in enumerate(members)}
        return {"lost": state.lost, "phase": state.phase} | together(parts)

    def unpack(self, arrays: Mapping[str, Array]) -> BankState:
        """The state of packed arrays."""
        pending = self._hindsight.unpack(under("pending.", arrays))
        # Before there was a reach, nothing held the members together.
        issues = tuple(_with_reach(issue, len(self.members) + 2) for issue in pending.issues)
        # Nor was anybody corrected; and other members may answer plans since.
        told, residuals = (
            under("residuals.", arrays),
            self._corrector.start(np.full(len(self.network.measured), np.nan)),
        )
        if told and np.array_equal(told["members"], residuals.members):
            residuals = Residuals(**told)
        return BankState(
            members=tuple(
                member.unpack(under(f"member.{place}.", arrays)) for place, member in enumerate(self.members)
            ),
            pending=pending._replace(issues=issues),
            costs=Costs(**under("costs.", arrays)),
            # Before answers to plans were judged, members were by what they had forecast for the heat that followed.
            answers=Costs(**(under("answers.", arrays) or under("costs.", arrays))),
            widths=Widths(**under("widths.", arrays)),
            residuals=residuals,
            lost=arrays["lost"],
            phase=arrays["phase"],
        )

    def _told(self, state: BankState) -> tuple[list[Mixture], Mixture]:
        """The members' distributions of the sample at the state's time, and what is published of them."""
        newest, parts, whole = self._newest
        if newest is not state or whole is None:
            parts = [member.predictive(own) for member, own in zip(self.members, state.members, strict=True)]
            parts = [reduced(part, _COMPONENTS) for part in parts]
            scale, reach = float(np.exp(state.widths.log_scale[0])), float(self._reaches(state)[0])
            whole = mixed(parts, self._weights(state)[:, 0], scale, reach)
            self._newest = state, parts, whole
        return parts, whole

    def _weights(self, state: BankState, among: Mask | None = None) -> Array:
        """(E, H): what every member, or each of those `among` (E,) them, weighs at each of `leads`; nothing while it
        cannot explain the samples."""
        places = np.flatnonzero(np.ones_like(self.plans) if among is None else among)
        prior, lost = self._prior[places], state.lost[places]
        if lost.any() and not lost.all():
            prior = np.where(lost[:, None] > 0.0, np.finfo(float).tiny, prior)
        found, costs = np.zeros_like(self._prior), state.costs._replace(excess=state.costs.excess[places])
        found[places] = weights(costs, prior, self.options.learning_rate, self.options.sharing)
        return found

    def _reaches(self, state: BankState) -> Array:
        """(H,): how far from the middle a member may be, by how many forecasts that do not overlap were verified."""
        return 1.0 + state.costs.hours / self._ahead

    def _bounds(self, state: BankState) -> Array | None:
        """(n_y, 2): what no forecast of hours goes beyond [degC], by the member that remembers what was measured. None
        without one, and where it does not count, as under a plan of heat that the room may never have had."""
        for member, own, lost in zip(self.members, state.members, state.lost, strict=True):
            if isinstance(member, ARX) and np.isfinite(lost) and not state.departs:
                return member.bounds(own)
        return None

    def _published(self, due: Due, bounds: Array | None) -> Mixture:
        """What was published of a forecast that is `due`: with the weights, the scale and the reach of its issue."""
        then = due.note[:, self.leads.index(due.lead)]
        return mixed(due.mixtures, then[:-2], then[-2], then[-1], bounds)

    def _learned(
        self, state: BankState, now: Array, outputs: Array, due: Sequence[Due], verified: Sequence[Verified]
    ) -> BankState:
        """Costs and widths after a sample, of which `due` are the members' forecasts and `verified` the published ones;
        `now` (E, H) are the weights.

        The weights learn from what a little more trust would be worth now. The width is learned for the mixture that
        was published, at the present scale: since then the weights have learned from forecasts of nearly the same
        hours, and the error of the mixture that they would make now is smaller than that of what anybody was told.
        """
        scales = np.exp(state.widths.log_scale)
        told: list[tuple[int, Sequence[Mixture], Mixture]] = [(0, *self._told(state))]
        for one, published in zip(due, verified, strict=True):
            horizon = self.leads.index(one.lead)
            whole = stretched(published.mixture, float(scales[horizon] / one.note[-2, horizon]))
            told.append((horizon, one.mixtures, whole))
        costs, widths = state.costs, state.widths
        for horizon, forecasts, whole in told:
            costs = self._charged(costs, horizon, forecasts, now, outputs)
            for i in np.flatnonzero(np.isfinite(outputs)).tolist():
                widths = with_place(
                    widths,
                    horizon,
                    distribution(whole, i, outputs[i]),
                    float(self._shares[horizon]),
                    level=self.options.coverage,
                    feedback=self.options.feedback,
                    first=self.options.first_feedback,
                )
        return state._replace(costs=costs, widths=widths)

    def _members_after(
        self, state: BankState, posteriors: Sequence[Posterior], vanished: Array, outputs: Array, due: Sequence[Due]
    ) -> BankState:
        """The members after a sample, told of the errors of what was `due` unless they refused the sample; who is lost
        starts anew."""
        members = [posterior.state for posterior in posteriors]
        if np.isnan(outputs).all():
            # Without a measurement a member that is lost does not show that it found back.
            return state._replace(members=tuple(members))
        lost = np.where(vanished, state.lost + 1.0, 0.0)
        for one in due:
            for place in np.flatnonzero(np.logical_not(vanished)).tolist():
                errors = outputs - one.mixtures[place].mean()
                members[place] = self.members[place].verified(members[place], one.lead, errors)
        # State of an earlier version may know no inputs yet: who is lost then waits for the next sample.
        if not vanished.all() and len(state.pending.inputs):
            for place in np.flatnonzero(lost >= _LOST).tolist():
                inputs = state.pending.inputs[-1, self._columns[place]]
                members[place] = self.members[place].restart(members[place], outputs, inputs)
                lost[place] = 0.0
        return state._replace(members=tuple(members), lost=lost)

    def _disturbance(self, now: Array, posteriors: Sequence[Posterior]) -> Callable[[Array], Disturbance] | None:
        """That of the first member with a model of it. Unless `plans` names that one, its heat is told by the member of
        `_knowing` that is trusted most, by the weights `now` (E, H)."""
        told = [posterior.disturbance for posterior in posteriors]
        able = np.array([disturbance is not None for disturbance in told])
        if not able.any():
            return None
        first, knowing = int(able.argmax()), self._knowing & able
        teller = first if self.plans[first] or not knowing.any() else self._most_trusted(now, knowing)
        noise, heat = told[first], told[teller]
        assert noise is not None
        assert heat is not None

        def disturbance(drive: Array) -> Disturbance:
            return noise(drive[self._columns[first]])._replace(gain=heat(drive[self._columns[teller]]).gain)

        return disturbance

    def _most_trusted(self, now: Array, among: Array | None = None) -> int:
        """The member `among` (E,), or of `_knowing`, that is trusted most a few hours ahead."""
        fit = np.flatnonzero(self._knowing if among is None else among).tolist()
        return max(fit or range(len(self.members)), key=lambda place: now[place, self.compared])


def _blind(member: Estimator) -> bool:
    return isinstance(member, Direct) and member.options.blind


def answering_plan(estimator: Estimator, state: Any) -> Any:
    """`state` of `estimator` as `issue` takes it to answer a plan of heating that somebody has chosen.

    A regression knows heating by what usually goes with it, so it answers what departs from habit by correlation. Of a
    bank, only the members that `Bank.plans` names tell what a departure changes. Any other estimator has but one
    answer, and its state stays as it is.
    """
    return estimator.answering_plan(state) if isinstance(estimator, Bank) else state


def by_physics(estimator: Estimator, state: Any) -> Any:
    """`state` of `estimator` as `issue` takes it to tell what is never usual, such as what a room does without sun and
    people: the members of a bank that `Bank.plans` names."""
    return estimator.by_physics(state) if isinstance(estimator, Bank) else state


def _with_reach(issue: Issue, rows: int) -> Issue:
    """`issue` with a note of as many `rows`."""
    note = issue.note
    return issue if len(note) == rows else issue._replace(note=np.vstack([note, np.full(note.shape[1], np.inf)]))


def _mixed_likelihood(shares: Array, posteriors: Sequence[Posterior]) -> float:
    """log p(y_k | y_1:k-1) of the members' mixture; NaN where nothing was assimilated."""
    likelihoods = np.array([posterior.log_likelihood for posterior in posteriors])
    known = np.isfinite(likelihoods) & (shares > 0.0)
    if not known.any():
        return float("nan")
    return float(np.logaddexp.reduce(likelihoods[known] + np.log(shares[known])))
