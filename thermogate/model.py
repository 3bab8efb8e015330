"""`fit`, `load` and what they return: a model that forecasts, explains itself and goes on learning."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import timedelta, tzinfo
from math import ceil
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from adapters.reading import Fault
from estimator.arrays import Array
from estimator.network.network import Network
from estimator.types import ParameterSummary
from estimator.verification.skill import persistence_crps, skill
from service.config.fitting import make_alignment
from service.errors import ConfigError, DataError
from service.fields.durations import format_duration, parse_duration
from service.records.sample import Sample
from thermogate.files import read_model, write_model
from thermogate.frames import Frame, Reader, check_columns, clock, moments, pandas, spacing, table
from thermogate.plans import plan_rows, steps_in
from thermogate.session import OUTCOMES, REGIMES, Session, horizon_names
from thermogate.settings import ZONE, Settings, network_of, settings_of

QUANTILES = (0.025, 0.5, 0.975)

_SLOW = 2.0
"""Seconds after which a fit shows its progress."""

FileName = str | PathLike[str]


def fit(
    df: Frame,
    network: str | Mapping[str, Any] | Network,
    *,
    columns: Mapping[str, Any] | None = None,
    tz: str | tzinfo | None = None,
    period: str | float | timedelta | None = None,
    estimator: str | None = None,
    estimator_options: Mapping[str, Any] | None = None,
    seed: int = 0,
    levels: Sequence[float] | None = None,
    max_gap: int | None = None,
    hold_inputs: str | float | timedelta | None = None,
    progress: bool = True,
) -> Model:
    """Learn the thermal model of a zone from a table of measurements, as the daemon would have learned it online.

    Args:
        df: a DataFrame with a DatetimeIndex; rows need no order and no even spacing.
        network: a preset such as "titeth", a table as in [zones.network], or a `Network`.
        columns: what a channel is read from, where the column does not have its name and unit: the name of a column, a
            pair of name and unit such as ("Heating kW", "kW"), or a table as in [zones.channels].
        tz: the time zone of an index without one, such as "Europe/Berlin"; otherwise that of the results.
        period: the sampling period, such as "15min"; None takes the usual distance of the rows.
        estimator, estimator_options, levels, max_gap, hold_inputs: as in [[zones]]; None is the daemon's default.
        seed: of the random numbers; the same seed gives the same bits.
        progress: whether a fit of more than two seconds shows a progress bar.

    Raises ConfigError for arguments and DataError for a table that cannot be used.
    """
    pandas()
    resolved = network_of(network)
    times = clock(df, tz, "the table")
    given: dict[str, Any] = {
        "period": spacing(times.seconds) if period is None else _plain(period),
        "estimator": estimator,
        "estimator_options": dict(estimator_options) if estimator_options is not None else None,
        "seed": seed,
        "levels": [levels] if isinstance(levels, float) else None if levels is None else list(levels),
        "max_gap": max_gap,
        "hold_inputs": _plain(hold_inputs),
    }
    known = {name: value for name, value in given.items() if value is not None}
    settings = settings_of(resolved, columns or {}, times.zone, known)
    used = {name for names in settings.source_columns.values() for name in names}
    others = tuple(name for name in map(str, df.columns) if name not in used)
    model = Model(Session(settings._replace(other_columns=others)))
    model._learn(df, None, progress, "fit")
    return model


def load(path: FileName) -> Model:
    """The model that `Model.save` wrote to `path`; it goes on with the same bits. DataError for any other file."""
    session, faults, last = read_model(Path(path))
    return Model(session, faults, last)


class Model:
    """A fitted model. `fit` and `load` make it."""

    def __init__(self, session: Session, faults: Counter[Fault] | None = None, last: int | None = None) -> None:
        self._session = session
        self._faults: Counter[Fault] = faults or Counter()
        self._last = last
        """Time of the last closed interval, UTC s."""

    @property
    def network(self) -> Network:
        """The thermal network, with its parameters and their bounds."""
        return self._settings.network

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

    def update(self, df: Frame, *, progress: bool = True) -> Model:
        """Go on learning from later measurements, and return the model itself.

        The columns are those of `fit`. Rows up to the last interval that the model has seen are passed over, as the
        daemon does after a restart. DataError where there is no later row.
        """
        self._learn(df, self._last, progress, "update")
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
                planned is held as it was last measured.
            horizon: how far beyond the next step, such as "24h".
            levels: of the prediction intervals.

        Returns a DataFrame by time with mean, median, sd, and lower_0.95 and upper_0.95 for the level .95. With several
        measured temperatures every column is a pair (output, quantity).
        """
        _check_levels(levels)
        _, rows = self._planned(plan, horizon)
        fan = self._session.worker.fan(levels, rows)
        assert fan is not None
        columns: dict[Any, list[float]] = {}
        for step in fan.steps:
            for output in step.outputs:
                quantities = {"mean": output.mean, "median": output.median, "sd": output.sd}
                for interval in output.intervals:
                    quantities[f"lower_{interval.level:g}"] = interval.lower
                    quantities[f"upper_{interval.level:g}"] = interval.upper
                for name, value in quantities.items():
                    columns.setdefault(self._key(output.output, name), []).append(value)
        return table(columns, self._moments([step.valid_time for step in fan.steps]))

    def scenarios(self, plan: Any = None, horizon: str | float | timedelta = "24h", count: int = 100) -> Frame:
        """`count` equally likely futures [degC] of the measured temperatures, without measurement noise: one column per
        future, and rows, plan and horizon as in `forecast`. DataError if the estimator samples none."""
        estimator = self._session.worker.estimator
        if not hasattr(estimator, "scenarios"):
            raise DataError(
                f'the estimator {self.estimator} samples no futures; fit with estimator="mkf" for scenarios'
            )
        if isinstance(count, bool) or not isinstance(count, int | np.integer) or not 1 <= count <= 100_000:
            raise DataError(f"count must be a whole number from 1 to 100000, not {count}")
        standing, rows = self._planned(plan, horizon)
        held = [used.value for used in standing.update.forecast.inputs]
        inputs = [[row.get(name, value) for name, value in zip(self.network.inputs, held, strict=True)] for row in rows]
        paths = estimator.scenarios(standing.state, np.array(inputs), int(count))
        first, period = standing.update.forecast.valid_time, self._settings.zone.period
        columns = {
            self._key(output, place): paths[place, :, i]
            for i, output in enumerate(self.network.measured)
            for place in range(len(paths))
        }
        return table(columns, self._moments([first + step * period for step in range(len(rows) + 1)]))

    def parameters(self, levels: Sequence[float] = QUANTILES) -> Frame:
        """Quantiles at `levels` of every parameter, its unit, the bounds of its prior, and whether it is learned."""
        network, summary = self.network, self._summary(levels)
        columns: dict[str, Any] = _quantiles(levels, summary.parameters)
        columns["unit"] = [parameter.unit for parameter in network.parameters]
        for name in ("lower", "upper"):
            bounds = [getattr(p, name) if p.free else float("nan") for p in network.parameters]
            columns[f"prior_{name}"] = bounds
        columns["free"] = [parameter.free for parameter in network.parameters]
        names = [parameter.name for parameter in network.parameters]
        return table(columns, pandas().Index(names, name="parameter"))

    def time_constants(self, levels: Sequence[float] = QUANTILES) -> Frame:
        """Quantiles at `levels` of the time constants [h], the fastest first."""
        found = self._summary(levels).time_constants / 3600.0
        names = [f"tau_{rank}" for rank in range(1, len(found) + 1)]
        return table({**_quantiles(levels, found), "unit": ["h"] * len(found)}, pandas().Index(names, name="parameter"))

    def heat_loss(self, levels: Sequence[float] = QUANTILES) -> Any:
        """Quantiles at `levels` of the heat loss coefficient [W/K], from the first measured node to all boundaries in
        steady state: a Series."""
        values = self._summary(levels).heat_loss
        return pandas().Series(values, index=[f"q{level:g}" for level in levels], name="heat_loss")

    @property
    def predictions(self) -> Frame:
        """Every sample against the interval that was forecast for it one step before.

        By time: y, mean, sd, the interval at the first of the levels, residual and crps [degC, K], then log_likelihood,
        outcome and segment. With several measured temperatures every column is a pair (output, quantity).
        """
        rows, level = self._session.updates.columns(), f"{self._settings.zone.levels[0]:g}"
        names = {"y": "y", "mean": "mean", "sd": "sd", "lower": f"lower_{level}", "upper": f"upper_{level}"}
        names |= {"residual": "residual", "crps": "crps"}
        columns = {
            self._key(output, shown): rows[f"{quantity}.{output}"]
            for output in self.network.measured
            for quantity, shown in names.items()
        }
        columns[self._key("", "log_likelihood")] = rows["log_likelihood"]
        columns[self._key("", "outcome")] = np.array(OUTCOMES)[rows["outcome"].astype(int)]
        columns[self._key("", "segment")] = rows["segment"].astype(int)
        return table(columns, self._moments(rows["time"]))

    @property
    def volatility(self) -> Frame:
        """The volatility alpha after every sample: lower and upper bound of its 95 % interval, median, and cdf, its
        place in its own history. With several blocks every column is a pair (block, quantity); without volatility
        there is no column."""
        rows, blocks = self._session.updates.columns(), self._session.worker.estimator.blocks
        columns = {
            (block, quantity) if len(blocks) > 1 else quantity: rows[f"alpha.{block}.{quantity}"]
            for block in blocks
            for quantity in ("lower", "median", "upper", "cdf")
        }
        return table(columns, self._moments(rows["time"]))

    @property
    def gate(self) -> Frame:
        """The learning gate after every sample, and the regime that it follows from."""
        rows = self._session.updates.columns()
        columns = {"gate": rows["gate"], "regime": np.array(REGIMES)[rows["regime"].astype(int)]}
        return table(columns, self._moments(rows["time"]))

    @property
    def parameter_history(self) -> Frame:
        """The posterior mean of every parameter after every sample."""
        rows = self._session.updates.columns()
        columns = {parameter.name: rows[f"theta.{parameter.name}"] for parameter in self.network.parameters}
        return table(columns, self._moments(rows["time"]))

    @property
    def verified(self) -> Frame:
        """Every forecast of `skill` one by one, by the time that it was for: horizon, output, y, mean, lower, upper,
        crps, and what persistence and ARX were wrong by."""
        rows, horizons = self._session.verified.columns(), horizon_names(self._settings.zone.period)
        index = self._moments(rows.pop("time"))
        columns: dict[str, Any] = dict(rows)
        columns["horizon"] = [horizons[int(place)] for place in rows["horizon"]]
        columns["output"] = [self.network.measured[int(place)] for place in rows["output"]]
        return table(columns, index)

    def skill(self, *, skip: str | float | timedelta = 0.0, last: str | float | timedelta | None = None) -> Frame:
        """How good the forecasts were, horizon by horizon, while the model learned.

        A forecast of hours is issued every hour and held to the measurement that came, under the inputs that really
        followed. `skip` leaves out so much at the beginning, and `last` takes so much at the end alone.

        Columns: forecasts (their number), coverage of the interval at the first level, width [K], rmse [K], crps [K],
        and the skill in CRPS against persistence and against an online ARX model: 1 is perfect, 0 as good, below 0
        worse.
        With several measured temperatures every row is a pair (output, horizon).
        """
        rows = self._session.verified.columns()
        times = self._session.updates.columns()["time"]
        begin = times[0] + _seconds(skip)
        if last is not None:
            begin = max(begin, times[-1] + self._settings.zone.period - _seconds(last))
        found = {
            (output, name): _scored({key: values[chosen] for key, values in rows.items()})
            for i, output in enumerate(self.network.measured)
            for place, name in horizon_names(self._settings.zone.period).items()
            for chosen in [(rows["output"] == i) & (rows["horizon"] == place) & (rows["time"] >= begin)]
        }
        pd = pandas()
        index = pd.MultiIndex.from_tuples(list(found), names=["output", "horizon"])
        frame = pd.DataFrame(list(found.values()), index=index)
        return frame if len(self.network.measured) > 1 else frame.droplevel("output")

    def save(self, path: FileName) -> None:
        """Write the model to one file, which `load` reads. It is NumPy's npz and holds no Python objects."""
        assert self._last is not None
        write_model(Path(path), self._session, self._faults, self._last)

    def __repr__(self) -> str:
        rows, zone = self._session.updates.columns(), self._settings.zone
        first, last = self._moments(rows["time"][[0, -1]])
        lines = [
            f"Thermogate model: network {self.network.name}, estimator {self.estimator}, a sample every "
            f"{format_duration(zone.period)}",
            f"  learned from {_count(len(rows['time']), 'sample')} in {_count(int(rows['segment'][-1]), 'segment')}, "
            f"{first:%Y-%m-%d %H:%M} to {last:%Y-%m-%d %H:%M} ({self._settings.tz})",
        ]
        worker = self._session.worker
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
            gate = worker.latest.gate
            lines.append(f"  volatility {medians or 'none'} ({gate.regime}), learning gate {gate.value:.2f}")
        if self._faults:
            lines.append("  not used: " + ", ".join(f"{count} {fault}" for fault, count in self.faults.items()))
        return "\n".join(lines)

    @property
    def _settings(self) -> Settings:
        return self._session.settings

    def _learn(self, df: Frame, resume_after: int | None, progress: bool, what: str) -> None:
        """Align a table as the daemon would and take every sample; warn of readings that were not used."""
        settings, before = self._settings, len(self._session.updates)
        times = clock(df, settings.tz, "the table")
        check_columns(df, settings.source_columns, settings.units, "the table")
        reader = Reader(df, times, settings.zone.channels, settings.units, ZONE)
        alignment = make_alignment(settings.zone, resume_after)
        first, last = reader.span()
        period = settings.zone.period
        if resume_after is not None and last < resume_after + period:
            until, newest = self._moments([resume_after + period, last])
            raise DataError(f"the table ends at {newest}, and the model has learned up to {until}; give later rows")
        since = first if resume_after is None else max(first, resume_after + period)
        with tqdm(
            total=max(1, ceil((last - since) / period)), unit=" samples", desc=what, delay=_SLOW, disable=not progress
        ) as bar:
            for part in reader.parts():
                self._take(alignment.add(ZONE, part.readings, part.now), bar)
            self._take(alignment.end(ZONE), bar)
        faults = alignment.faults + reader.faults
        self._last = alignment.closed_until - period
        self._faults += faults
        sentences = reader.refused(faults)
        if before == len(self._session.updates) == 0:
            why = self._session.worker.progress.stalled or "there is no reading"
            raise DataError("; ".join([f"no row of the table could be used: {why}", *sentences]))
        for sentence in sentences:
            warnings.warn(sentence, stacklevel=3)

    def _take(self, samples: Sequence[Sample], bar: Any) -> None:
        for sample in samples:
            # Whoever interrupts a fit can go on after the last sample.
            self._last = sample.time
            self._session.take(sample)
            bar.update()

    def _planned(self, plan: Any, horizon: str | float | timedelta) -> tuple[Any, list[dict[str, float]]]:
        """What stands, and the planned inputs of every step; DataError where nothing stands."""
        worker = self._session.worker
        if worker.standing is None or worker.progress.stalled:
            raise DataError(
                f"there is no forecast: {worker.progress.stalled}; update the model with newer measurements"
            )
        steps = steps_in(horizon, self._settings.zone.period)
        begin = worker.standing.update.forecast.valid_time
        return worker.standing, plan_rows(plan, self._settings, begin, steps)

    def _summary(self, levels: Sequence[float]) -> ParameterSummary:
        _check_levels(levels)
        estimator = self._session.worker.estimator
        if not getattr(estimator, "physical", True):
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


def _scored(rows: Mapping[str, Array]) -> dict[str, float]:
    """Scores of forecasts that are rows of `Session.verified`."""
    count, y = len(rows["y"]), rows["y"]
    mean = np.mean if count else lambda _: float("nan")
    persisted = persistence_crps(rows["persistence_error"])
    return {
        "forecasts": count,
        "coverage": float(mean((rows["lower"] <= y) & (y <= rows["upper"]))),
        "width": float(mean(rows["upper"] - rows["lower"])),
        "rmse": float(np.sqrt(mean((y - rows["mean"]) ** 2))),
        "crps": float(mean(rows["crps"])),
        "skill_persistence": skill(rows["crps"], persisted),
        "skill_arx": skill(rows["crps"], rows["arx_crps"]),
    }


def _quantiles(levels: Sequence[float], values: Array) -> dict[str, Any]:
    return {f"q{level:g}": values[:, place] for place, level in enumerate(levels)}


def _plain(duration: Any) -> Any:
    """A duration as the configuration knows it: a timedelta as seconds, anything else as it is."""
    return duration.total_seconds() if isinstance(duration, timedelta) else duration


def _seconds(duration: Any) -> float:
    """A duration as in the configuration, or a timedelta, in s; ConfigError for anything else."""
    try:
        return parse_duration(_plain(duration))
    except ValueError as error:
        raise ConfigError([str(error)]) from None


def _check_levels(levels: Sequence[float]) -> None:
    if isinstance(levels, str | float | int) or not len(levels) or not all(0.0 < level < 1.0 for level in levels):
        raise DataError(f"levels must be a list of numbers between 0 and 1, such as [0.5, 0.95], not {levels}")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
