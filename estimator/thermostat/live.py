"""What a zone forecasts live: its physics with the thermostat's law inside, under the set-points to come.

Two questions are answered, and each learns from its own verified forecasts.

Under a plan of set-points the members that a bank asks about plans simulate, each draw with the law inside. They weigh
what they proved to be worth at that question, from a prior by what the bank trusts them with.

Without a plan nobody knows what people will set. Several futures are told apart: set-points as in each of GUESSES with
the law inside, and the heat held, with all members; where no heat obeys a set-point, the heat held or as a day before;
and what the regressions of a bank say that ask for no input to come. They weigh what they proved to be worth, horizon
by horizon, by exponentiated gradient on the CRPS as the members of a bank do (`estimator.bank.weights`).

Both are held to what came as they were asked: under the inputs that were foreseen at the issue, with a plan also under
the set-points that followed. Widths are kept as the bank keeps its own (`estimator.bank.coverage`), with one exception.
While the thermostat holds a room, all draws of a model agree, and what it is off by is what the thermostat leaves: the
swing of a relay, a droop, sun. That does not grow with what the model is unsure of. So there, future by future, the
errors of verified forecasts that had the room held are added (`estimator.thermostat.held`), and there are two learned
widths for the other times: with all heat on, and with none.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from estimator.arrays import HOUR, Array, Indices, together, under
from estimator.bank.bank import Bank
from estimator.bank.coverage import Widths, no_widths, with_place
from estimator.bank.mixing import mixed, mixed_futures, stretched
from estimator.bank.weights import COMPONENTS, Costs, between, costs_of, no_costs, weights, with_cost
from estimator.foresight import Weather, weather
from estimator.thermostat import held
from estimator.thermostat.closed_loop import Course, Paths, course_of
from estimator.thermostat.futures import GUESSES, NOTHING_KNOWN, ToCome, guesses
from estimator.thermostat.law import Laws
from estimator.thermostat.memory import Memory, reaches_back
from estimator.thermostat.thermostat import Thermostat
from estimator.types import Estimator, Mixture, Mixtures, ModelDraws
from estimator.verification.hindsight import EVERY, HORIZONS
from estimator.verification.scores import distribution, reduced

FUTURES = (*GUESSES, "heat-held", "heat-of-yesterday", "by-regression")
"""Of a forecast without a plan; the last three do not ask what the thermostat is set to, and the last one asks for no
heat."""

_BY_REGRESSION = len(FUTURES) - 1

PLANNED, UNPLANNED = 0, 1
"""The two questions."""

_WIDTHS = ("planned", "unplanned", "forced", "energy")
"""What has a width of its own: plans with the heat off, no plan, plans with all heat on, the energy of a plan."""

_FORCED, _ENERGY = 2, 3

LEVEL = 0.95
"""Of the interval whose coverage is kept."""

_PRIOR = (0.4, 1.0, 0.5, 0.7, 0.4, 0.6, 1.0)
"""What each future weighs before it has proved anything, relative to the others."""

_SCHEDULED = (8.0, *_PRIOR[1:])
"""The same where a schedule sets the set-points."""

_DISCOUNT, _RATE, _SHARING, _FEEDBACK = 0.998, 0.1, 0.5, 0.02
"""As the defaults of a bank."""

_FIRST = 1.0
"""The `first_feedback` of a bank, whose default is smaller."""

_KEPT = 12
"""Draws of each member that wait for the set-points that follow."""

_TRIED = 64
"""Draws of all members of a future that is held to what came."""

_DRAWS = 160
"""Draws of all members of a forecast that is told."""

_FEWEST = 12
"""Draws of a member that counts."""

_COUNTED = 4
"""Members that count at most at a lead, those with the largest weights; the others cost time and change little."""

_NEGLIGIBLE = 0.02
"""Weight below which, if it has no more at any lead, a member or a future is left out."""

_LEAST_TRUSTED = 0.1
"""What a member weighs at least before it has proved anything under plans: the bank knows members by the heat that
followed, where a room that warms up or cools down is no harder than one that is held."""

_APART = 23
"""Between the numbers of the futures of the weather with which two members begin."""

_BEYOND = 3.0
"""K beyond what a room has seen that a future is still believed."""

_GONE = 1e-6
"""Weight of a future that is not believed, relative to one that is: where no other is left, it still counts."""


class Issue(NamedTuple):
    """A forecast of both questions that waits for its time; H leads, E physical members, F futures."""

    step: Array
    """()."""
    drawn: tuple[Mapping[str, Array], ...]
    """Of each physical member: the arrays of its draws."""
    before: Array
    """(n_u,): inputs in force at the issue."""
    foreseen: Array
    """(hours, n_d): hourly means of the drive rows that were foreseen."""
    strays: Array
    """(n_u,): as `estimator.foresight.strays` says of them."""
    trusted: Array
    """(H, E): weights of the members before they proved anything under plans."""
    shares: Array
    """(H, E): weights of the members; 0 for those that did not count."""
    futures: Array
    """(H, F, 3, COMPONENTS): weights, means and sds of the first output in each future; NaN where there was none."""
    chances: Array
    """(H, F): weights of the futures."""
    scales: Array
    """(3, H): by which forecasts of temperatures were stretched, by _WIDTHS."""
    errors: Array
    """(H, N): errors [K] that were added where the thermostat holds the room."""
    stands: Array
    """(): for how many forecasts of every hour it stands: until the next one, where they are made seldom."""


class Live(NamedTuple):
    """What was proved so far, and what waits to be."""

    step: int
    setpoints: Array
    """(m,): of the last m steps, the newest last [degC]."""
    heat: Array
    """(m,): what obeyed the laws in these steps, all together, in the unit of its inputs."""
    issues: tuple[Issue, ...]
    members: Costs
    """Of E members at H leads, under plans."""
    futures: Costs
    """Of F futures."""
    widths: tuple[Widths, ...]
    """By _WIDTHS."""
    errors: Array
    """(H, N): of the last forecasts under a plan that had the room held [K], the newest last."""


class Now(NamedTuple):
    """The moment from which a forecast is made."""

    state: Any
    """The estimator's, predicted to the next sample."""
    thermostat: Thermostat
    before: Array
    """(n_u,): inputs in force."""
    time: int
    """Of the state [UTC s]."""


class Heat(NamedTuple):
    """What N futures of h steps call for."""

    values: Array
    """(N, h, n_laws): what each law's input gives over each step."""
    weights: Array
    """(h, N): of the futures, at each step."""
    weather: Indices
    """(N,): as `estimator.thermostat.closed_loop.Paths` has it."""


class Ahead(NamedTuple):
    """What is foreseen of h steps."""

    rows: Array
    """(h, n_d): drive rows, with the heat held where nobody plans it."""
    yesterday: Array
    """(h, n_d): the same with the heat of the day before."""
    strays: Array
    """(n_u,): how far the inputs may come to stray from them; 0 for what is known."""


class Fan(NamedTuple):
    """A forecast of L times."""

    outputs: Mixtures
    """Of the outputs at the state's time, and after each of L - 1 steps."""
    heat: Heat
    """Of L - 1 steps."""
    chances: Array
    """(L - 1, F): what each future weighs at each step; no column under a plan."""
    simulated: int
    """Components of `outputs`, the first ones, that are paths of a model of the building, unless none is."""
    energy_scales: Array
    """(L - 1,): by which the energies from now until after each step are to be stretched about their mean."""

    def paths(self, count: int) -> Array:
        """(count, L, n_y): simulated futures [degC] without the sensor's noise, as likely as their weight at the last
        time; each begins at the mean of the first."""
        last = self.outputs.weights[-1, : self.simulated]
        places = (np.arange(count) + 0.5) / count * last.sum()
        chosen = np.minimum(np.searchsorted(np.cumsum(last), places), len(last) - 1)
        found = self.outputs.means[:, :, chosen]
        found[0] = self.outputs.at(0).mean()[:, None]
        return np.asarray(found.transpose(2, 0, 1))


_Future = tuple[Mixtures, Callable[[], Heat]]
"""The outputs at L leads, and the heat over the steps that lead there."""


class LiveForecasts:
    """The forecasts of one zone with a set-point, by `estimator`. Every method is pure."""

    def __init__(self, estimator: Estimator, seed: int, to_come: ToCome = NOTHING_KNOWN) -> None:
        self._estimator = estimator
        self._seed = seed
        self._to_come = to_come
        bank = estimator if isinstance(estimator, Bank) else None
        members = [estimator] if bank is None else bank.members
        physical = [member.physical for member in members] if bank is None else bank.plans
        self._places = np.flatnonzero(physical).tolist()
        self._members = [members[place] for place in self._places]
        self._bank = bank
        self._columns = [estimator.network.columns(member.network) for member in self._members]
        """What of the estimator's drive row drives each of them."""
        leads = {round(horizon / estimator.period) for horizon in HORIZONS}
        self.leads = tuple(sorted(lead for lead in leads if lead > 1))
        """Steps ahead at which both questions are verified; the first step is the published forecast, whoever asks."""
        prior = np.array(_PRIOR if to_come.schedule is None else _SCHEDULED)
        self._prior = np.tile(prior[:, None], len(self.leads))
        self._hours = max(1, round(EVERY / estimator.period)) * estimator.period / HOUR
        self._steps_an_hour = max(1, round(HOUR / estimator.period))

    def begin(self) -> Live:
        """Nothing was proved."""
        count = len(self.leads)
        return Live(
            step=0,
            setpoints=np.empty(0),
            heat=np.empty(0),
            issues=(),
            members=no_costs(len(self._members), count),
            futures=no_costs(len(FUTURES), count),
            widths=tuple(no_widths(count) for _ in _WIDTHS),
            errors=held.no_errors(count),
        )

    def restarted(self, live: Live) -> Live:
        """After a gap: what was pending has lost its time, what was proved is kept."""
        return live._replace(setpoints=live.setpoints[:0], heat=live.heat[:0], issues=())

    def knows(self, thermostat: Thermostat, time: float) -> bool:
        """Whether `unplanned` has futures beside the heat held: in a bank, with a law, or once set-points of a day
        before `time` [UTC s] are remembered."""
        return self._bank is not None or self.obeyed(thermostat) or reaches_back(thermostat.memory, time)

    def obeyed(self, thermostat: Thermostat) -> bool:
        """Whether a plan of set-points can be answered: a member has physics, and heat obeys a set-point."""
        return bool(self._members and len(thermostat.laws.column))

    def planned(self, live: Live, now: Now, setpoints: Array, ahead: Ahead) -> Fan | None:
        """The forecast under planned `setpoints` (h,) [degC] and what is foreseen `ahead`; None where no member has
        physics, or no heat obeys a set-point."""
        if not self.obeyed(now.thermostat) or not len(ahead.rows):
            return None
        leads = np.arange(2, len(ahead.rows) + 2, dtype=np.float64)
        shares = self._shares(live, now.state)
        courses = self._courses(now, shares, ahead, _DRAWS)
        outputs, heat = self._under(live, courses, shares, now.thermostat, setpoints, leads)
        everyone = outputs.weights.shape[1]
        scales = self._scales(live, _ENERGY, leads)
        outputs = outputs.after(self._estimator.predictive(now.state))
        return Fan(outputs, heat(), np.empty((len(ahead.rows), 0)), everyone, scales)

    def unplanned(self, live: Live, now: Now, ahead: Ahead) -> Fan:
        """The forecast where nobody plans."""
        leads = np.arange(2, len(ahead.rows) + 2, dtype=np.float64)
        chances = between(self._chances(live, now.thermostat).T, self.leads, leads)
        chosen = chances.max(axis=1) >= _NEGLIGIBLE
        futures = self._futures(live, now, ahead, chosen, _DRAWS, leads)
        chances = np.where(chosen[:, None], chances, 0.0)
        chances /= chances.sum(axis=0)
        scales = self._scales(live, UNPLANNED, leads)
        places = sorted(futures)
        outputs = mixed_futures([futures[place][0] for place in places], chances[places], scales)
        # Whoever asks for no heat tells of none.
        heated = [place for place in places if place != _BY_REGRESSION] or places
        of_heat = chances[heated] / np.maximum(chances[heated].sum(axis=0), 1e-12)
        return Fan(
            outputs=outputs.after(self._estimator.predictive(now.state)),
            heat=_joined([futures[place][1]() for place in heated], of_heat),
            chances=chances.T,
            simulated=sum(futures[place][0].weights.shape[1] for place in heated),
            energy_scales=np.ones(len(leads)),
        )

    def likely(self, live: Live, thermostat: Thermostat, times: Array) -> Array:
        """(h,): the set-points [degC] at `times` (h,) [UTC s], ascending, by the guess that weighs most hours ahead;
        NaN where there is no law."""
        chances = self._chances(live, thermostat)[-1, : len(GUESSES)]
        if not chances.any():
            return np.full(len(times), np.nan)
        told = guesses(thermostat.memory, thermostat.setpoint, times, self._to_come)
        return np.asarray(told[int(np.argmax(chances))])

    def learned(self, live: Live, thermostat: Thermostat, outputs: Array) -> Live:
        """After a sample with `outputs` (n_y,) that the estimator did not refuse."""
        value = float(outputs[0])
        if np.isfinite(value):
            for horizon, issue in self._due(live):
                live = self._learned_of_plan(live, thermostat, horizon, issue, value)
                live = self._learned_of_none(live, horizon, issue, value)
        return live

    def _learned_of_plan(self, live: Live, thermostat: Thermostat, horizon: int, issue: Issue, value: float) -> Live:
        """What the members make of the set-points that followed, under the other inputs that were foreseen; what had
        been told of it had the weights, the scales and the errors of the issue."""
        laws, memory = thermostat.laws, thermostat.memory
        steps, shares = self.leads[horizon] - 1, issue.shares[horizon]
        setpoints = live.setpoints[len(live.setpoints) - steps :]
        if not len(laws.column) or not self._members or np.isnan(setpoints).any() or len(setpoints) < steps:
            return live
        rows = np.repeat(issue.foreseen, self._steps_an_hour, axis=0)[:steps]
        network, period, origin = self._estimator.network, self._estimator.period, int(issue.step)
        to_come = weather(network, issue.strays, period, steps, round(origin * period))
        # Who does not count yet is judged as well: otherwise it could never prove anything.
        parts, own, of, energies, last = [], [], [], [], np.array([steps])
        for place, member in enumerate(self._members):
            draws = _draws(member.network, issue.drawn[place])
            paths = self._course(draws, place, laws, rows, issue.before, to_come, origin).under(setpoints)
            end, believed = paths.mixtures(last).at(0), _believed(paths, setpoints, memory)[-1]
            parts.append(Mixture(believed / believed.sum(), end.means[:1], end.sds[:1]))
            own.append(shares[place] * believed.sum())
            energies.append(np.abs(paths.heat).sum(axis=(1, 2)))
            on = paths.on(last, laws, self._steps_an_hour)
            of.append(held.states(paths.temperatures[:, -1:, 0].T, laws, setpoints[-1:], on)[0])
        now = self._weights(live.members, issue.trusted.T)[:, horizon]
        everyone = range(len(parts))
        stands = float(issue.stands)
        judged = _judged(live.members, horizon, parts, now, value, stands * self._hours, everyone)
        live = live._replace(members=judged)
        counted = np.flatnonzero(shares > 0.0).tolist()
        told = mixed([parts[place] for place in counted], np.array(own)[counted] / np.sum(own), 1.0)
        futures = told._replace(means=np.concatenate([energies[place] for place in counted])[None])
        live = self._energy_widened(live, horizon, futures, float(live.heat[len(live.heat) - steps :].sum()), stands)
        states = np.concatenate([of[place] for place in counted])
        state = int(np.argmax(np.bincount(states, told.weights)))
        if state == held.HELD:
            kept = states == held.HELD
            error = value - float(np.average(told.means[0, kept], weights=told.weights[kept]))
            return live._replace(errors=held.with_error(live.errors, horizon, error))
        width = PLANNED if state == held.IDLE else _FORCED
        scales = issue.scales[[PLANNED, _FORCED], horizon]
        strayed = held.strayed_by_all(told, states, scales, issue.errors[horizon])
        return self._widened(live, width, horizon, strayed, float(issue.scales[width, horizon]), value, stands)

    def _learned_of_none(self, live: Live, horizon: int, issue: Issue, value: float) -> Live:
        """What the futures of an issue made of it."""
        there, parts = _parts(issue, horizon)
        if not there:
            return live
        now = self._weights(live.futures, self._prior)[there, horizon]
        stands, scale = float(issue.stands), float(issue.scales[UNPLANNED, horizon])
        futures = _judged(live.futures, horizon, parts, now / now.sum(), value, stands * self._hours, there)
        whole = _unplanned(issue, horizon, scale)
        return self._widened(live._replace(futures=futures), UNPLANNED, horizon, whole, scale, value, stands)

    def _energy_widened(self, live: Live, horizon: int, futures: Mixture, value: float, stands: float) -> Live:
        """The width of energies after those of `futures` were held to `value`, that of the same steps."""
        sd = float(np.sqrt(np.average((futures.means[0] - futures.mean()[0]) ** 2, weights=futures.weights)))
        if not np.isfinite(value) or sd <= 0.0:
            return live
        told = Mixture(np.ones(1), futures.mean()[:, None], np.full((1, 1), sd))
        return self._widened(live, _ENERGY, horizon, told, 1.0, value, stands)

    def _widened(
        self, live: Live, width: int, horizon: int, mixture: Mixture, scale: float, value: float, stands: float
    ) -> Live:
        """The width, by _WIDTHS, after a `mixture`, told with `scale`, was held to `value`: at the present scale, as a
        bank learns it. It `stands` for so many forecasts of every hour."""
        widths = list(live.widths)
        present = float(np.exp(widths[width].log_scale[horizon])) / scale
        widths[width] = with_place(
            widths[width],
            horizon,
            distribution(stretched(mixture, present), 0, value),
            min(stands * self._hours / (self.leads[horizon] * self._estimator.period / HOUR), 1.0),
            level=LEVEL,
            feedback=_FEEDBACK,
            first=_FIRST,
            stands=stands,
        )
        return live._replace(widths=tuple(widths))

    def advanced(self, live: Live, now: Now, ahead: Callable[[int], Ahead] | None, apart: int = 1) -> Live:
        """One period on, under the inputs in force and the newest set-point.

        Where both questions are answered now, to be held to what comes, `ahead(h)` is what is foreseen of h steps;
        otherwise it is None. They are answered every hour, or `apart` times as seldom.
        """
        step, longest = live.step + 1, max(self.leads, default=0)
        issues = live.issues
        while issues and step - int(issues[0].step) >= longest:
            issues = issues[1:]
        setpoints = np.concatenate([live.setpoints, [now.thermostat.setpoint]])
        column = now.thermostat.laws.column.astype(np.int64)
        heat = np.concatenate([live.heat, [np.abs(now.before[column]).sum() if len(column) else np.nan]])
        if longest and ahead is not None and self.knows(now.thermostat, now.time):
            issues = (*issues, self._issue(live, step, now, ahead(longest - 1), apart))
        kept = step - int(issues[0].step) if issues else 0
        first = len(setpoints) - kept
        return live._replace(step=step, setpoints=setpoints[first:], heat=heat[first:], issues=issues)

    def issued(self, live: Live) -> list[Mixture] | None:
        """The forecasts without a plan that were issued at this very step, of the first output at each of `leads`; None
        where none was."""
        if not live.issues or int(live.issues[-1].step) != live.step:
            return None
        issue, scales = live.issues[-1], live.issues[-1].scales[UNPLANNED]
        return [_unplanned(issue, horizon, scale) for horizon, scale in enumerate(scales.tolist())]

    def pack(self, live: Live) -> dict[str, Array]:
        """Everything as arrays, by name."""
        arrays = {"step": np.array(live.step), "errors": live.errors}
        arrays |= {"setpoints": live.setpoints, "heat": live.heat}
        arrays |= together({"members.": live.members._asdict(), "futures.": live.futures._asdict()})
        arrays |= together({f"{width}.": one._asdict() for width, one in zip(_WIDTHS, live.widths, strict=True)})
        if live.issues:
            for name in _PLAIN:
                arrays[f"issues.{name}"] = np.stack([getattr(issue, name) for issue in live.issues])
            for place in range(len(self._members)):
                for name in live.issues[0].drawn[place]:
                    arrays[f"drawn.{place}.{name}"] = np.stack([issue.drawn[place][name] for issue in live.issues])
        return arrays

    def unpack(self, arrays: Mapping[str, Array]) -> Live:
        """What was packed, with the same bits; the beginning for what was stored before there was any of it, or is of
        other members or leads. Forecasts that wait are dropped where they say nothing of what was foreseen."""
        fresh = self.begin()
        alike = ("members.excess", fresh.members.excess), ("futures.excess", fresh.futures.excess)
        if "step" not in arrays or any(arrays[name].shape != known.shape for name, known in alike):
            return fresh
        issues = []
        for row in range(len(arrays["issues.step"]) if "issues.foreseen" in arrays else 0):
            drawn = tuple(
                {name: values[row] for name, values in under(f"drawn.{place}.", arrays).items()}
                for place in range(len(self._members))
            )
            # What was issued before it was known that foresight errs took it for exact, and came every hour.
            exact = {"strays": np.zeros_like(arrays["issues.before"][row]), "stands": np.array(1.0)}
            told = {name: arrays[f"issues.{name}"][row] for name in _PLAIN if f"issues.{name}" in arrays}
            issues.append(Issue(drawn=drawn, **(exact | told)))
        return Live(
            step=int(arrays["step"]),
            setpoints=arrays["setpoints"],
            heat=arrays.get("heat", np.full(len(arrays["setpoints"]), np.nan)),
            issues=tuple(issues),
            members=Costs(**under("members.", arrays)),
            futures=Costs(**under("futures.", arrays)),
            widths=tuple(
                Widths(**(old._asdict() | under(f"{width}.", arrays)))
                for width, old in zip(_WIDTHS, fresh.widths, strict=True)
            ),
            errors=arrays.get("errors", fresh.errors),
        )

    def _issue(self, live: Live, step: int, now: Now, ahead: Ahead, apart: int) -> Issue:
        chances, state = self._chances(live, now.thermostat), now.state
        leads = np.array(self.leads, dtype=np.float64)
        everything = self._futures(live, now, ahead, chances[0] > 0.0, _TRIED, leads)
        futures = np.full((len(self.leads), len(FUTURES), 3, COMPONENTS), np.nan)
        for place, (mixtures, _) in everything.items():
            for horizon in range(len(self.leads)):
                one = mixtures.at(horizon)
                small = reduced(Mixture(one.weights, one.means[:1], one.sds[:1]), COMPONENTS)
                size = len(small.weights)
                futures[horizon, place] = np.array([0.0, 20.0, 1.0])[:, None]
                futures[horizon, place, :, :size] = small.weights / small.weights.sum(), small.means[0], small.sds[0]
        drawn = (member.draws(own, _KEPT) for member, own in zip(self._members, self._states(state), strict=True))
        return Issue(
            step=np.array(step, dtype=np.int64),
            drawn=tuple(_arrays(one) for one in drawn if one is not None),
            before=now.before,
            foreseen=_hourly(ahead.rows, self._steps_an_hour),
            strays=ahead.strays,
            trusted=self._trusted(state).T,
            shares=self._shares(live, state).T,
            futures=futures,
            chances=chances,
            scales=np.exp(np.array([each.log_scale for each in live.widths[:_ENERGY]])),
            errors=live.errors,
            stands=np.array(float(apart)),
        )

    def _futures(
        self, live: Live, now: Now, ahead: Ahead, chosen: Array, count: int, leads: Array
    ) -> dict[int, _Future]:
        """Those that are `chosen` (F,), by their place."""
        rows, state, thermostat = ahead.rows, now.state, now.thermostat
        times = now.time + self._estimator.period * np.arange(len(rows), dtype=np.float64)
        found: dict[int, _Future] = {}
        if chosen[: len(GUESSES)].any():
            shares = self._shares(live, state)
            courses = self._courses(now, shares, ahead, count)
            told = guesses(thermostat.memory, thermostat.setpoint, times, self._to_come)
            for place in np.flatnonzero(chosen[: len(GUESSES)]).tolist():
                # Most days are like others: who guesses the same has the same future.
                alike = next((other for other in found if np.array_equal(told[other], told[place])), -1)
                found[place] = found.get(alike) or self._under(live, courses, shares, thermostat, told[place], leads)
        for place in (np.flatnonzero(chosen[len(GUESSES) :]) + len(GUESSES)).tolist():
            planned = ahead.yesterday if FUTURES[place] == "heat-of-yesterday" else rows
            after = _steps(leads)
            if self._bank is None:
                issue = self._estimator.issue(state, count if count == _TRIED else self._estimator.forecast_draws)
                outputs = self._estimator.unfold(issue, planned).during(after)
            else:
                asked = self._bank.by_regression(state) if place == _BY_REGRESSION else state
                outputs = self._bank.futures(asked, planned, after)
            found[place] = outputs, partial(_planned_heat, planned[after - 1], thermostat.laws)
        return found

    def _under(
        self,
        live: Live,
        courses: Mapping[int, Course],
        shares: Array,
        thermostat: Thermostat,
        setpoints: Array,
        leads: Array,
    ) -> _Future:
        """The members' futures under `setpoints` (h,), mixed, as wide as they proved to be."""
        laws, after = thermostat.laws, _steps(leads)
        own = between(shares, self.leads, leads)
        counted = [place for place in courses if own[place].any()]
        paths, own = [courses[place].under(setpoints) for place in counted], own[counted]
        believed = [_believed(each, setpoints, thermostat.memory)[after - 1] for each in paths]
        own = own * np.array([each.sum(axis=1) for each in believed])
        own = own / own.sum(axis=0)
        mixtures = [each.mixtures(after)._replace(weights=some) for each, some in zip(paths, believed, strict=True)]
        outputs = mixed_futures(mixtures, own, np.ones(len(leads)))
        on = np.concatenate([each.on(after, laws, self._steps_an_hour) for each in paths], axis=1)
        states = held.states(outputs.means[:, 0], laws, setpoints[after - 1], on)
        scales = np.stack([self._scales(live, width, leads) for width in (PLANNED, _FORCED)])
        errors = held.spread_out(live.errors, self.leads, leads, [len(each.weights) for each in paths])
        return held.strayed(outputs, states, scales, errors), partial(_heat, paths, own, after)

    def _courses(self, now: Now, shares: Array, ahead: Ahead, count: int) -> dict[int, Course]:
        """The members that count, by their place, on their way over what is foreseen `ahead`."""
        period, steps, laws = self._estimator.period, len(ahead.rows), now.thermostat.laws
        origin = now.time // round(period)
        to_come = weather(self._estimator.network, ahead.strays, period, steps, round(origin * period))
        states, most = self._states(now.state), shares.max(axis=1)
        found = {}
        for place in np.flatnonzero(most > 0.0).tolist():
            drawn = self._members[place].draws(states[place], max(_FEWEST, round(count * most[place] / most.sum())))
            assert drawn is not None
            found[place] = self._course(drawn, place, laws, ahead.rows, now.before, to_come, origin)
        return found

    def _course(
        self, draws: ModelDraws, place: int, laws: Laws, rows: Array, before: Array, to_come: Weather, origin: int
    ) -> Course:
        """The member at `place`, by its `draws`, on its way over the estimator's `rows` (h, n_d)."""
        astray = to_come.chosen(draws.network, np.arange(len(draws.weights)) + _APART * place)
        own, period, seed = rows[:, self._columns[place]], self._estimator.period, self._seed + place
        return course_of(draws, period, laws, own, before, seed=seed, origin=origin, astray=astray)

    def _due(self, live: Live) -> Iterator[tuple[int, Issue]]:
        for horizon, lead in enumerate(self.leads):
            for issue in live.issues:
                if live.step - int(issue.step) + 1 == lead:
                    yield horizon, issue

    def _states(self, state: Any) -> list[Any]:
        members = (state,) if self._bank is None else state.members
        return [members[place] for place in self._places]

    def _trusted(self, state: Any) -> Array:
        """(E, H): what the members weigh before they proved anything under plans of set-points: what the bank trusts
        them with under plans of heat."""
        if self._bank is None or not self._members:
            return np.ones((len(self._members), len(self.leads)))
        asked = self._bank.by_physics(state)
        everyone = np.array(list(self._bank.member_weights(asked).values()))[self._places]
        own = between(everyone, self._bank.leads, np.array(self.leads, dtype=np.float64))
        return np.maximum(own / own.sum(axis=0), _LEAST_TRUSTED)

    def _shares(self, live: Live, state: Any) -> Array:
        """(E, H): weights of the physical members under plans of set-points; 0 for those that do not count."""
        if not self._members:
            return np.empty((0, len(self.leads)))
        found = self._weights(live.members, self._trusted(state))
        least = np.sort(found, axis=0)[-min(_COUNTED, len(found))]
        found = np.where((found >= least) & (found >= _NEGLIGIBLE), found, 0.0)
        return np.asarray(found / found.sum(axis=0))

    def _scales(self, live: Live, width: int, leads: Array) -> Array:
        """(L,): by which forecasts `leads` (L,) steps ahead are stretched; `width` is by _WIDTHS. One step is not."""
        known = np.concatenate([[0.0], live.widths[width].log_scale])
        return np.asarray(np.exp(between(known, (1, *self.leads), leads)))

    def _chances(self, live: Live, thermostat: Thermostat) -> Array:
        """(H, F): weights of the futures without a plan: of set-points with a law, otherwise of heat."""
        found = self._weights(live.futures, self._prior)
        obeyed = self.obeyed(thermostat) and not np.isnan(thermostat.setpoint)
        found[FUTURES.index("heat-of-yesterday") if obeyed else slice(len(GUESSES))] = 0.0
        if self._bank is None or not self._bank.regresses:
            found[_BY_REGRESSION] = 0.0
        found = found / found.sum(axis=0)
        return np.asarray(found.T)

    def _weights(self, costs: Costs, prior: Array) -> Array:
        return weights(costs, prior, _RATE, _SHARING)


def _parts(issue: Issue, horizon: int) -> tuple[list[int], list[Mixture]]:
    """The futures without a plan that there were, by their places."""
    there = np.flatnonzero(np.isfinite(issue.futures[horizon, :, 0, 0])).tolist()
    return there, [Mixture(issue.futures[horizon, i, 0], *issue.futures[horizon, i, 1:, None]) for i in there]


def _unplanned(issue: Issue, horizon: int, scale: float) -> Mixture:
    """What was told without a plan."""
    there, parts = _parts(issue, horizon)
    return mixed(parts, issue.chances[horizon, there], scale)


def _judged(
    costs: Costs,
    horizon: int,
    parts: Sequence[Mixture],
    now: Array,
    value: float,
    hours: float,
    there: Sequence[int],
) -> Costs:
    """`costs` after `value` came, of which `parts` with weights `now` were the forecasts by those `there`; the others
    count as good as all together."""
    cost, total = costs_of(parts, now, 0, value)
    everyone = np.full(len(costs.excess), float((now * cost).sum()))
    everyone[list(there)] = cost
    return with_cost(costs, horizon, everyone, total, hours, _DISCOUNT) if np.isfinite(everyone).all() else costs


def _believed(paths: Paths, setpoints: Array, memory: Memory) -> Array:
    """(h, K): weights of the futures, next to nothing from where they leave, by _BEYOND, what the room has seen in a
    fortnight or is set to: what a member's own gain brings about hours ahead may be heat that no house has."""
    seen = np.concatenate([memory.temperatures, setpoints])
    room = paths.temperatures[:, 1:, 0]
    gone = np.logical_or.accumulate((room < np.nanmin(seen) - _BEYOND) | (room > np.nanmax(seen) + _BEYOND), axis=1)
    return np.asarray((paths.weights[:, None] * np.where(gone, _GONE, 1.0)).T, dtype=np.float64)


def _steps(leads: Array) -> Indices:
    """(L,): steps from the state's time to the `leads` (L,): it is one step ahead."""
    return np.asarray(leads, dtype=np.int64) - 1


def _heat(paths: Sequence[Paths], shares: Array, after: Indices) -> Heat:
    """The heat of all paths over the steps that end `after` (L,) steps, of members with `shares` (E, L)."""
    each = [Heat(one.heat[:, after - 1], np.tile(one.weights, (len(after), 1)), one.weather) for one in paths]
    return _joined(each, shares)


def _planned_heat(rows: Array, laws: Laws) -> Heat:
    """That of a future whose inputs are `rows` (L, n_d)."""
    return Heat(rows[None, :, laws.column.astype(np.int64)], np.ones((len(rows), 1)), np.array([-1]))


def _joined(each: Sequence[Heat], shares: Array) -> Heat:
    """The futures of all, who have `shares` (E, h)."""
    weights = [share[:, None] * one.weights for one, share in zip(each, shares, strict=True)]
    return Heat(
        np.concatenate([one.values for one in each]),
        np.concatenate(weights, axis=1),
        np.concatenate([one.weather for one in each]),
    )


def _hourly(rows: Array, steps: int) -> Array:
    """(hours, n_d): means of `rows` (h, n_d), of which `steps` make an hour."""
    begins = np.arange(0, len(rows), steps)
    counts = np.diff(np.append(begins, len(rows)))
    return np.asarray(np.add.reduceat(rows, begins, axis=0) / counts[:, None])


_PLAIN = tuple(name for name in Issue._fields if name != "drawn")

_LEFT_OUT = ("network", "member", "share", "point", "mean", "covariance", "point_is_fan")


def _arrays(draws: ModelDraws) -> dict[str, Array]:
    """The arrays that a simulation of `draws` needs."""
    return {name: np.asarray(value) for name, value in draws._asdict().items() if name not in _LEFT_OUT}


def _draws(network: Any, arrays: Mapping[str, Array]) -> ModelDraws:
    nothing = np.empty(0)
    values: dict[str, Any] = dict(arrays) | {"gain_stays": float(arrays["gain_stays"])}
    return ModelDraws(network=network, point=nothing, mean=nothing, covariance=nothing, **values)
