"""A fitted model: it forecasts, explains itself and goes on learning."""

import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from datetime import timedelta
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any, Self

import numpy as np

from adapters.fields.durations import format_duration
from adapters.fields.numbers import is_level, number_in, whole_in
from adapters.fields.words import shown
from adapters.reading import Fault
from estimator.arrays import Array
from estimator.diagnosis.finding import Finding
from estimator.network.network import Network
from estimator.types import ParameterSummary
from estimator.verification.scores import gaussian_crps
from replay.recorded.trace import Trace
from service.errors import DataError, NoLaw, NoModel, PlanError
from service.forecast.engine import FanQuestion
from service.forecast.foresight import NO_WEATHER
from service.forecast.heating import (
    CompareQuestion,
    Course,
    DemandQuestion,
    PreheatQuestion,
    check_until,
    moment,
    refusal,
)
from service.forecast.learned import learned_laws
from service.forecast.request import detail
from service.records.fan import CompactOutputPayload, Fan
from service.records.outlook import SET_POINTS
from service.records.skill import Skill
from service.records.view import Answer, Question
from thermogate import plots
from thermogate.arguments import items, plain
from thermogate.files import write_model
from thermogate.frames import Frame, clock, moments, named_zone, pandas, table
from thermogate.heating import BOUNDS_95, comparison_table, demand_table, demand_total, preheat_series
from thermogate.learning import learn
from thermogate.plans import planned_inputs, planned_price, planned_setpoints, steps_in
from thermogate.session import ALPHA, BOUNDS, OUTCOMES, REGIMES, Session

QUANTILES = (0.025, 0.5, 0.975)


class Model:
    """A fitted model. `fit` and `load` make it."""

    def __init__(self, session: Session, faults: Counter[Fault] | None = None) -> None:
        self._session, self._settings = session, session.settings
        self._faults: Counter[Fault] = faults or Counter()

    @property
    def network(self) -> Network:
        """The thermal network, with its parameters and their bounds."""
        return self._settings.zone.network

    @property
    def estimator(self) -> str:
        """The estimator's name."""
        return self._settings.zone.estimator

    @property
    def period(self) -> timedelta:
        """The sampling period."""
        return timedelta(seconds=self._settings.zone.period)

    @property
    def faults(self) -> dict[str, int]:
        """How many readings were not used, by the reason."""
        return {str(fault): count for fault, count in self._faults.items()}

    def update(self, df: Frame, *, progress: bool = True) -> Self:
        """Go on learning from later measurements, and return the model itself.

        The columns are those of `fit`. Rows up to the last interval that the model has seen are passed over, as the
        daemon does after a restart. DataError where there is no later row.
        """
        learned = learn(self._session, df, progress, "update")
        self._faults += learned.faults
        for sentence in learned.warnings:
            warnings.warn(sentence, stacklevel=2)
        return self

    def forecast(
        self,
        plan: Any = None,
        horizon: str | float | timedelta = "24h",
        levels: Sequence[float] = (0.95,),
    ) -> Frame:
        """The measured temperatures [degC] of the next step and of `horizon` beyond it.

        Args:
            plan: planned inputs, as a DataFrame or a dict of columns. Values with times count from their time on; a
                list has one value per step, of which the first holds from the first row of the forecast on; a number
                holds throughout. Names and units are those of the columns of `fit`, or the network's own. What is not
                planned follows the shape of the day before if it is weather, and is otherwise held as last measured.
            horizon: how far beyond the next step, such as "24h".
            levels: of the prediction intervals.

        Returns a DataFrame by time with mean, median, sd, and lower_0.95 and upper_0.95 for the level .95. With several
        measured temperatures every column is a pair (output, quantity).
        """
        checked = _checked_levels(levels)

        def quantities(output: CompactOutputPayload) -> Iterator[tuple[str, Array]]:
            yield from (("mean", output.mean), ("median", output.median), ("sd", output.sd))
            for level, lower, upper in zip(checked, output.lower, output.upper, strict=True):
                yield from ((f"lower_{level:g}", lower), (f"upper_{level:g}", upper))

        return self._by_step(self._asked(plan, horizon, checked), quantities)

    def predict(self, X: Any = None, quantiles: Sequence[float] = QUANTILES) -> Frame:
        """Quantiles of the measured temperatures [degC] at the times of `X`, as scikit-learn's users expect them.

        `X` is a DataFrame of planned inputs by time, or the times alone; None: the next day. Its times are among those
        of `forecast`, from the next step on; what it does not plan is foreseen.

        Returns a DataFrame with the index of `X` and a column q0.025, q0.5, ... for each of `quantiles`.
        """
        checked, pd = _checked_levels(quantiles), pandas()
        begin, period, rows = self._begin(), self._settings.zone.period, None
        horizon: str | float = "24h"
        if X is not None:
            frame = X if isinstance(X, pd.DataFrame) else pd.DataFrame(index=X)
            times = clock(frame, self._settings.tz, "X")
            rows = np.rint((times.seconds - begin) / period)
            if not (rows >= 0).all() or (np.abs(times.seconds - begin - rows * period) > 0.5).any():
                first, second = self._moments([begin, begin + period])
                raise DataError(
                    f"X has times that are no forecast's; forecasts are for {first}, {second} and so on. What was "
                    "forecast for earlier times is in model.predictions"
                )
            horizon = max(1, int(rows.max())) * period
        # The bound of a central interval is a quantile.
        levels = sorted({abs(2.0 * q - 1.0) for q in checked} - {0.0}) or [0.5]

        def bounds(output: CompactOutputPayload) -> Iterator[tuple[str, Array]]:
            for q in checked:
                side = output.lower if q < 0.5 else output.upper
                yield f"q{q:g}", output.median if q == 0.5 else side[levels.index(abs(2.0 * q - 1.0))]

        found = self._by_step(self._asked(X if isinstance(X, pd.DataFrame) else None, horizon, levels), bounds)
        return found if rows is None else found.iloc[rows.astype(int)].set_axis(frame.index)

    def scenarios(self, plan: Any = None, horizon: str | float | timedelta = "24h", count: int = 100) -> Frame:
        """`count` equally likely futures [degC] of the measured temperatures, without measurement noise: one column per
        future, and rows, plan and horizon as in `forecast`. DataError if the estimator knows no physics."""
        number = whole_in(plain(count), 1, 100_000)
        if number is None:
            raise DataError(f"count must be a whole number from 1 to 100000, not {shown(items(count))}")
        try:
            fan = self._asked(plan, horizon, (), number)
        except NoModel:
            raise DataError(
                f"the estimator {self.estimator} knows no physics and samples no futures; fit with another estimator"
            ) from None
        return self._by_step(fan, lambda output: enumerate(output.scenarios))

    def preheat(self, target: float, by: Any, *, probability: float = 0.9, tolerance: float = 0.5) -> Any:
        """The latest time to raise the set-point for the zone to be warm in time: a Series.

        Args:
            target: temperature to reach [degC].
            by: when: the next time of day, such as "06:30", or a time.
            probability: of being warm in time.
            tolerance: K below the target at which the zone counts as warm.

        `start` is NaT where not even now is early enough; `reached` then tells how likely it still is. DataError, as
        for `demand` and `compare`, where no law of a thermostat is known, or the forecasts cannot be trusted.
        """
        begin = self._begin()
        wanted, below, likely = (number_in(plain(value)) for value in (target, tolerance, probability))
        if wanted is None or below is None or below <= 0.0 or likely is None or not is_level(likely):
            raise DataError(
                "target and tolerance must be numbers in degC and K, and probability one between 0 and 1, not "
                f"{shown([plain(target), plain(tolerance), plain(probability)])}"
            )
        planned_setpoints({SET_POINTS: wanted}, self._settings, begin, 1)
        try:
            when = moment(by if isinstance(by, str) else self._time(by), begin, named_zone(self._settings.tz))
            check_until(when, begin, self._settings.zone.period)
        except PlanError as error:
            raise DataError(f"by {error}") from None
        question = PreheatQuestion(wanted, when, likely, below)
        return preheat_series(self._answer(question, when - begin), self._settings.tz)

    def demand(self, plan: Any = None, horizon: str | float | timedelta = "24h", *, hourly: bool = True) -> Any:
        """The energy [kWh] that the thermostat will call for, with its 95 % interval: a DataFrame by hour, or the whole
        horizon as a Series. `plan` is one of set-points, such as {"T_set": 20.0}; by default they are foreseen."""
        begin, steps = self._begin(), steps_in(horizon, self._settings.zone.period)
        planned = None if plan is None else planned_setpoints(plan, self._settings, begin, steps)
        found = self._answer(DemandQuestion(steps, planned), steps * self._settings.zone.period).demand
        return demand_table(found, self._settings.tz) if hourly else demand_total(found)

    def compare(self, plans: Any, horizon: str | float | timedelta = "24h", *, price: Any = None) -> Frame:
        """What plans of set-points come to, and how much more that is than under the first of them: energy [kWh], hours
        below the set-points of the first plan, and the cost at a `price` of a kWh, each with its 95 % interval.

        `plans` is a dict of plans by name, such as {"as now": {"T_set": 21.0}, "cooler": {"T_set": 20.0}}. The interval
        of a difference is that of the difference itself: what two plans have in common cancels out.
        """
        if not isinstance(plans, Mapping) or len(plans) < 2:
            raise DataError('plans must be a dict of at least two, such as {"as now": {"T_set": 21.0}, ...}')
        settings, begin, steps = self._settings, self._begin(), steps_in(horizon, self._settings.zone.period)
        courses = [Course(str(name), planned_setpoints(plan, settings, begin, steps)) for name, plan in plans.items()]
        cost = None if price is None else planned_price(price, settings, begin, steps)
        return comparison_table(self._answer(CompareQuestion(steps, courses, cost), steps * settings.zone.period))

    def parameters(self, levels: Sequence[float] = QUANTILES) -> Frame:
        """Quantiles at `levels` of every parameter, its unit, the bounds of its prior, and whether it is learned. Of
        intervals that have collapsed, surer than any telemetry allows, all but the median are NaN."""
        checked = _checked_levels(levels)
        network, summary = self.network, self._summary(checked)
        columns: dict[str, Any] = _quantiles(checked, summary.parameters)
        columns["unit"] = [parameter.unit for parameter in network.parameters]
        for name in ("lower", "upper"):
            bounds = [getattr(p, name) if p.free else float("nan") for p in network.parameters]
            columns[f"prior_{name}"] = bounds
        columns["free"] = [parameter.free for parameter in network.parameters]
        names = [parameter.name for parameter in network.parameters]
        return table(columns, pandas().Index(names, name="parameter"))

    def time_constants(self, levels: Sequence[float] = QUANTILES) -> Frame:
        """Quantiles at `levels` of the time constants [h], the fastest first."""
        checked = _checked_levels(levels)
        found = self._summary(checked).time_constants / 3600.0
        names = [f"tau_{rank}" for rank in range(1, len(found) + 1)]
        columns = {**_quantiles(checked, found), "unit": ["h"] * len(found)}
        return table(columns, pandas().Index(names, name="parameter"))

    def heat_loss(self, levels: Sequence[float] = QUANTILES) -> Any:
        """Quantiles at `levels` of the heat loss coefficient [W/K], from the first measured node to all boundaries in
        steady state: a Series."""
        checked = _checked_levels(levels)
        values = self._summary(checked).heat_loss
        return pandas().Series(values, index=[f"q{level:g}" for level in checked], name="heat_loss")

    def known_heat(self, levels: Sequence[float] = QUANTILES) -> Frame:
        """Quantiles at `levels` of the coefficients of sun and habits, with node and unit: apertures [m2], what people
        heat by the hour and what days off differ by [W]. No rows where the zone knows neither."""
        checked = _checked_levels(levels)
        found = self._summary(checked).coefficients
        terms = self.network.terms[: len(found)]
        columns: dict[str, Any] = _quantiles(checked, found.reshape(len(terms), len(checked)))
        columns |= {"unit": [term.unit for term in terms], "node": [term.node for term in terms]}
        return table(columns, pandas().Index([term.name for term in terms], name="term"))

    @property
    def thermostat(self) -> Frame:
        """The learned law of the thermostat by heat input: side, law, explained share and days, and power [W], offset
        and band [K] with their 95 % intervals. No rows where none is known."""
        found = learned_laws(self._session.worker)
        columns = {name: [getattr(law, name) for law in found] for name in ("side", "law", "explained", "days")}
        for name in ("power", "offset", "band"):
            columns |= {f"{name}_{bound}": [getattr(getattr(law, name), bound) for law in found] for bound in BOUNDS_95}
        return table(columns, pandas().Index([law.channel for law in found], name="channel"))

    @property
    def predictions(self) -> Frame:
        """Every sample against the interval that was forecast for it one step before.

        By time: y, mean, sd, the interval at the first of the levels, residual and crps [degC, K], then log_likelihood,
        outcome and segment. With several measured temperatures every column is a pair (output, quantity).
        """
        rows, level = self._session.columns(), f"{self._settings.zone.levels[0]:g}"
        names = {"y": "y", "mean": "mean", "sd": "sd", "lower": f"lower_{level}", "upper": f"upper_{level}"}
        names |= {"residual": "residual"}
        columns: dict[Any, Array] = {}
        for output in self.network.measured:
            own = {quantity: rows[f"{quantity}.{output}"] for quantity in names}
            columns |= {self._key(output, shown): own[quantity] for quantity, shown in names.items()}
            columns[self._key(output, "crps")] = gaussian_crps(-own["residual"], own["sd"], 0.0)
        columns[self._key("", "log_likelihood")] = rows["log_likelihood"]
        columns[self._key("", "outcome")] = np.array(OUTCOMES)[rows["outcome"].astype(int)]
        columns[self._key("", "segment")] = rows["segment"].astype(int)
        return table(columns, self._moments(rows["time"]))

    @property
    def volatility(self) -> Frame:
        """The volatility alpha after every sample: lower and upper bound of its 95 % interval, median, and cdf, its
        place in its own history. With several blocks every column is a pair (block, quantity); without volatility
        there is no column."""
        rows, blocks = self._session.columns(), self._session.worker.estimator.blocks
        columns = {
            (block, quantity) if len(blocks) > 1 else quantity: rows[f"alpha.{quantity}.{block}"]
            for block in blocks
            for quantity in ALPHA
        }
        return table(columns, self._moments(rows["time"]))

    @property
    def gate(self) -> Frame:
        """The learning gate after every sample, and the regime that it follows from."""
        rows = self._session.columns()
        columns = {"gate": rows["gate"], "regime": np.array(REGIMES)[rows["regime"].astype(int)]}
        return table(columns, self._moments(rows["time"]))

    @property
    def parameter_history(self) -> Frame:
        """The posterior mean of every parameter after every sample."""
        rows = self._session.columns()
        columns = {parameter.name: rows[f"theta.{parameter.name}"] for parameter in self.network.parameters}
        return table(columns, self._moments(rows["time"]))

    @property
    def disturbance(self) -> Frame:
        """What the estimator knows of what nobody measures, after every sample: unmeasured heat [W] into the first
        measured node with its 95 % interval, the probability that there is any, and the same bounds of the measurement
        noise [K] of every output. NaN for an estimator without a model of it."""
        rows = self._session.columns()
        columns = {f"gain_{bound}": rows[f"gain.{bound}"] for bound in BOUNDS}
        columns["probability_on"] = rows["gain.probability_on"]
        columns |= {
            f"measurement_sd_{output}_{bound}": rows[f"sd.{bound}.{output}"]
            for output in self.network.measured
            for bound in BOUNDS
        }
        return table(columns, self._moments(rows["time"]))

    def skill(self, days: int = 30, as_issued: bool = False) -> Frame:
        """How good the model's forecasts of the first measured temperature were over the last 1, 7 or 30 `days`,
        horizon by horizon, each made before the measurement that it is held to: hours ahead under the inputs that
        really followed.

        Columns: forecasts (their number), coverage and width [K] of the 95 % interval, crps and rmse [K], the rmse [K]
        of persistence (nothing changes) and of an online ARX model, and the skill against both, the share by which the
        model's rmse is smaller: 1 is perfect, 0 as good, below 0 worse.

        With `as_issued`, under the inputs foreseen then: beside their scores stand rmse and crps of persistence and of
        the measurement a day before.
        """
        found, number = self._skill(), number_in(plain(days))
        windows = [window.days for window in found.windows]
        if number is None or number not in windows:
            known = ", ".join(map(str, windows))
            raise DataError(f"days must be one of {known}, not {shown(items(days))}")
        period = self._settings.zone.period
        own = found.issued_over(int(number)) if as_issued else found.over(int(number))
        rows = {_horizon(one.lead, period): asdict(one) for one in own}
        index = pandas().Index(list(rows), name="horizon")
        shorter = {f"skill_against_{name}": f"skill_{name}" for name in ("persistence", "arx")}
        return pandas().DataFrame(list(rows.values()), index=index).drop(columns="lead").rename(columns=shorter)

    @property
    def findings(self) -> Frame:
        """What the model does not know or what is not plausible about it, now: the name of each finding, its subject,
        and one sentence with the problem and the remedy."""
        found = self._session.worker.diagnosis().findings
        return pandas().DataFrame([asdict(one) for one in found], columns=[one.name for one in fields(Finding)])

    @property
    def weights(self) -> Frame:
        """What each member of a bank weighs, horizon by horizon; no rows for another estimator."""
        found, period = self._skill(), self._settings.zone.period
        names = [_horizon(one.lead, period) for one in found.longest]
        weights = {one.member: one.weights for one in found.members}
        return pandas().DataFrame.from_dict(weights, orient="index", columns=names).rename_axis("member")

    def plot(self, what: str | None = None, *, plan: Any = None, horizon: str | float | timedelta = "24h") -> Any:
        """A matplotlib Figure of `what`: "forecast" (under `plan` over `horizon`, as in `forecast`), "history",
        "profile" (heat besides the heating by the hour) or "parameters"; by default of all that the model has.

        For the first measured temperature. DataError for what the model does not have.
        """
        trace, tz = self._trace(), self._settings.tz
        output, worker = self.network.measured[0], self._session.worker
        panels: dict[str, plots.Draw] = {}
        if what == "forecast" or (what is None and worker.unstalled is not None):
            fan = self.forecast(plan, horizon, (0.5, 0.95))
            own = fan[output] if len(self.network.measured) > 1 else fan
            panels["Forecast"] = plots.forecast(own, trace, output, tz)
        if what in (None, "history"):
            panels["History"] = plots.history(trace, tz)
        if what == "profile" and not plots.warms(trace):
            raise DataError(
                f"the estimator {self.estimator} knows of no heat besides the heating; fit with bank or mkf"
            )
        if what in (None, "profile") and plots.warms(trace):
            panels["Heat besides the heating"] = plots.profile(trace, tz)
        if what == "parameters" or (what is None and worker.estimator.physical):
            panels["Parameters"] = plots.parameters(self.parameters())
        if not panels:
            raise DataError(f"what is forecast, history, profile or parameters, not {shown(what)}")
        return plots.drawn(panels)

    def report(self, path: str | PathLike[str], *, language: str = "en") -> Path:
        """Write the [report](report.md) of what the model has learned from as one HTML page, and return its path.

        It is called after the file. `language` is "en" or "de".
        """
        from replay.reports.publish import report_page
        from service.publish.language import LANGUAGES

        if language not in LANGUAGES:
            raise DataError(f"language is {' or '.join(LANGUAGES)}, not {shown(language)}")
        target = Path(path)
        trace = self._trace()._replace(zone=target.stem)
        try:
            target.write_text(report_page(target.stem, [trace], language), encoding="utf-8")
        except OSError as error:
            raise DataError(f"the report cannot be written to {path} ({error.strerror}); choose another file") from None
        return target

    def save(self, path: str | PathLike[str]) -> None:
        """Write the model to one file, which `load` reads. It is NumPy's npz and holds no Python objects."""
        write_model(Path(path), self._session, self._faults)

    def __repr__(self) -> str:
        zone, worker = self._settings.zone, self._session.worker
        first, last = self._moments(self._session.span())
        lines = [
            f"Thermogate model: network {self.network.name}, estimator {self.estimator}, a sample every "
            f"{format_duration(zone.period)}",
            f"  learned from {_count(len(self._session), 'sample')} in {_count(worker.progress.segment, 'segment')}, "
            f"{first:%Y-%m-%d %H:%M} to {last:%Y-%m-%d %H:%M} ({self._settings.tz})",
        ]
        if worker.progress.stalled or worker.latest is None:
            lines.append(f"  no forecast: {worker.progress.stalled}")
        else:
            forecast = worker.latest.forecast
            when = self._moments([forecast.valid_time])[0]
            lines += [
                f"  {one.output} at {when:%Y-%m-%d %H:%M}: {one.mean:.2f} degC, {one.intervals[0].level:.0%} between "
                f"{one.intervals[0].lower:.2f} and {one.intervals[0].upper:.2f}"
                for one in forecast.outputs
            ]
            medians = ", ".join(f"{value:.2g}" for value in worker.latest.volatility.median)
            gate = worker.latest.shown_gate
            lines.append(f"  volatility {medians or 'none'} ({gate.regime}), learning gate {gate.value:.2f}")
        if found := self._session.worker.diagnosis().findings:
            lines.append(f"  {_count(len(found), 'finding')}: see model.findings")
        if self._faults:
            lines.append("  not used: " + ", ".join(f"{count} {fault}" for fault, count in self.faults.items()))
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        room = self._session.tracer.trace(self.faults).room
        told = [] if room is None else [f"<b>{escape(one.what)}</b>: {escape(one.why)}" for one in room.to_do]
        told += [] if room is None else [escape(one.sentence) for one in room.answers]
        skill = self.skill()[["forecasts", "coverage", "crps", "rmse", "skill_persistence"]]
        return (
            f"<pre>{escape(repr(self))}</pre><ul>{''.join(f'<li>{sentence}</li>' for sentence in told)}</ul>"
            f"{skill.to_html(float_format='{:.3g}'.format)}"
        )

    def _asked(self, plan: Any, horizon: str | float | timedelta, levels: Sequence[float], scenarios: int = 0) -> Fan:
        """The forecast under `plan`; DataError where there is none."""
        begin, steps = self._begin(), steps_in(horizon, self._settings.zone.period)
        planned = planned_inputs(plan, self._settings, begin, steps)
        return self._answer(FanQuestion(steps, planned, tuple(levels), scenarios, detail([steps + 1])))

    def _begin(self) -> float:
        """When the forecast begins, UTC s; DataError where there is none."""
        worker = self._session.worker
        if worker.unstalled is None:
            raise DataError(
                f"there is no forecast: {worker.progress.stalled}; update the model with newer measurements"
            )
        return worker.unstalled.update.forecast.valid_time

    def _answer(self, question: Question[Answer | None], lead: float | None = None) -> Answer:
        """The answer to `question`; DataError where there is none, or, over a `lead` [s], none to rely on."""
        worker = self._session.worker
        why = None if lead is None else refusal(worker.trust, lead)
        if why is not None:
            raise DataError(f"the model {why}")
        try:
            found = question(worker, NO_WEATHER, lambda: False)
        except NoLaw as error:
            raise DataError(f"the model cannot say: {error}") from None
        assert found is not None
        return found

    def _time(self, when: Any) -> str:
        """A time as `moment` reads it; one without a time zone is in that of the table."""
        try:
            stamp = pandas().Timestamp(when)
        except (TypeError, ValueError):
            return str(when)
        return str((stamp if stamp.tzinfo else stamp.tz_localize(self._settings.tz)).isoformat())

    def _trace(self) -> Trace:
        found = self._session.tracer.trace(self.faults)
        if not found.rows:
            raise DataError("the model was saved by a Thermogate that kept no history in it; fit it again")
        return found

    def _by_step(self, fan: Fan, quantities: Callable[[CompactOutputPayload], Iterable[tuple[Any, Array]]]) -> Frame:
        first, period = fan.update.forecast.valid_time, self._settings.zone.period
        times = self._moments([first + step * period for step in range(len(fan.outputs[0].mean))])
        found = {self._key(one.output, name): values for one in fan.outputs for name, values in quantities(one)}
        return table(found, times)

    def _skill(self) -> Skill:
        found = self._session.worker.skill()
        assert found is not None
        return found

    def _summary(self, levels: Sequence[float]) -> ParameterSummary:
        if not self._session.worker.estimator.physical:
            raise DataError(
                f"the estimator {self.estimator} has no parameters of a building; fit with another estimator"
            )
        found = self._session.worker.parameters(levels)
        assert found is not None
        return found

    def _moments(self, seconds: Sequence[float] | Array) -> Any:
        return moments(seconds, self._settings.tz)

    def _key(self, output: str, quantity: Any) -> Any:
        """The heading of a column: with several outputs, a pair."""
        return (output, quantity) if len(self.network.measured) > 1 else quantity


def _quantiles(levels: Sequence[float], values: Array) -> dict[str, Any]:
    return {f"q{level:g}": values[:, place] for place, level in enumerate(levels)}


def _horizon(lead: float, period: float) -> str:
    return "1 step" if lead == period else f"{lead / 3600:g}h"


def _checked_levels(levels: object) -> list[float]:
    """`levels` as numbers; DataError if they are no list of numbers between 0 and 1."""
    found = items(levels)
    numbers = [number_in(level) for level in found] if isinstance(found, list) else []
    checked = [number for number in numbers if number is not None and is_level(number)]
    if not checked or len(checked) < len(numbers):
        raise DataError(f"levels must be a list of numbers between 0 and 1, such as [0.5, 0.95], not {shown(found)}")
    return checked


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
