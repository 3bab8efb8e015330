"""`backtest` and `compare`: what forecasts along a table would have been worth."""

import warnings
from collections.abc import Mapping, Sequence
from datetime import tzinfo
from typing import Any

import numpy as np

from estimator.errors import EstimatorError
from estimator.network.network import Network
from estimator.network.presets import AUTO
from replay.experiments.hours_ahead.contenders import NAIVE, jobs_of, named
from replay.experiments.hours_ahead.figures import COUNT, COVERAGE, CRPS, LARGEST, RMSE, WIDTH, figures, key
from replay.experiments.hours_ahead.forecasts import FIRST_DAYS, LATER, PERSISTENCE, leads_of
from replay.experiments.hours_ahead.recordings import Recording, of_record
from replay.experiments.jobs import Arrays
from replay.experiments.series.recorded_zone import record_of
from replay.experiments.study import Contender
from service.errors import ConfigError, DataError
from service.recordings.progress import Progress
from thermogate.arguments import items
from thermogate.frames import Frame, moments, pandas
from thermogate.learning import taken
from thermogate.settings import Settings, settings_for

_SCORES = {
    "forecasts": COUNT,
    "coverage": COVERAGE,
    "width": WIDTH,
    "crps": CRPS,
    "rmse": RMSE,
    "largest_error": LARGEST,
}


class Backtest:
    """Forecasts along a table, 1 step, 1 h, 6 h and 24 h ahead under the inputs that really followed, each by a model
    that had learned only what came before it. `backtest` and `compare` make it."""

    def __init__(self, recording: Recording, runs: Mapping[str, Arrays], tz: str) -> None:
        self._recording, self._runs, self._tz = recording, runs, tz
        self._leads = {_short(name): place for place, name in enumerate(leads_of(recording.period))}

    @property
    def scores(self) -> Frame:
        """How good the forecasts were that were made after the first three days: a row for every estimator and horizon.

        Columns: forecasts (their number), coverage and width [K] of the 95 % interval, crps, rmse and largest_error
        [K], and skill_persistence, the share by which the rmse is smaller than that of the forecast that nothing
        changes. A point forecast has no interval.
        """
        return self._scores(LATER)

    @property
    def first_days(self) -> Frame:
        """The same of the first three days, or of the first half of a table that is little longer."""
        return self._scores(FIRST_DAYS)

    def forecasts(self, estimator: str | None = None, horizon: str = "24h") -> Frame:
        """Every forecast `horizon` ahead by the time that it is about: y, mean, lower_0.95 and upper_0.95 [degC], and
        crps [K]. `estimator` is one of those compared; by default the last one."""
        name = list(self._runs)[-1] if estimator is None else estimator
        if name not in self._runs or horizon not in self._leads:
            raise DataError(
                f"there are no forecasts {horizon} ahead by {name}; the estimators are {', '.join(self._runs)}, and "
                f"the horizons {', '.join(self._leads)}"
            )
        arrays, place = self._runs[name], self._leads[horizon]
        columns = {"y": self._recording.series.outputs[:, 0]}
        for shown, own in {"mean": "mean", "lower_0.95": "lower", "upper_0.95": "upper", "crps": "crps"}.items():
            columns[shown] = arrays[own][:, place]
        table = pandas().DataFrame(columns, index=moments(self._recording.series.times.astype(np.float64), self._tz))
        return table[np.isfinite(columns["mean"])]

    def __repr__(self) -> str:
        return f"Backtest after `first_days`\n{self.scores}"

    def _repr_html_(self) -> str:
        return f"<p>Backtest after <code>first_days</code></p>{self.scores.to_html(float_format='{:.3g}'.format)}"

    def _scores(self, window: str) -> Frame:
        rows: dict[tuple[str, str], dict[str, float]] = {}
        for name, arrays in self._runs.items():
            found = figures(self._recording, arrays)
            for horizon in leads_of(self._recording.period):
                own = {column: found.get(key(score, horizon, window), np.nan) for column, score in _SCORES.items()}
                naive = rows.get((PERSISTENCE, _short(horizon)), own)["rmse"]
                skill = 1.0 - own["rmse"] / naive if naive else np.nan
                rows[name, _short(horizon)] = {**own, "skill_persistence": skill}
        index = pandas().MultiIndex.from_tuples(list(rows), names=("estimator", "horizon"))
        return pandas().DataFrame(list(rows.values()), index=index)


def backtest(
    df: Frame,
    network: str | Mapping[str, Any] | Network = AUTO,
    *,
    columns: Mapping[str, Any] | None = None,
    tz: str | tzinfo | None = None,
    progress: bool = True,
    **settings: Any,
) -> Backtest:
    """What the forecasts of a model would have been worth, had it learned along the table `df`: beside that nothing
    changes (persistence), and that a day is like the one before (yesterday). Arguments and errors are those of `fit`.
    """
    checked = settings_for(df, network, columns, tz, settings)
    own = Contender(checked.zone.estimator, checked.zone.estimator, checked.zone.estimator_options)
    return _run(df, checked, [*map(named, NAIVE), own], progress)


def compare(
    df: Frame,
    estimators: Sequence[str] = ("bank", "ekf", "arx"),
    network: str | Mapping[str, Any] | Network = AUTO,
    *,
    columns: Mapping[str, Any] | None = None,
    tz: str | tzinfo | None = None,
    progress: bool = True,
    **settings: Any,
) -> Backtest:
    """`backtest` for several estimators at once.

    `estimators` are names, or names with options such as "mkf:particles=32"; besides there are "ridge" and "boosting",
    regressions for each horizon. Other arguments and errors are those of `fit`.
    """
    listed = items(estimators)
    wanted = [named(str(text), "estimators:") for text in ([listed] if isinstance(listed, str) else listed)]
    naive = [named(PERSISTENCE)] if PERSISTENCE not in [one.estimator for one in wanted] else []
    return _run(df, settings_for(df, network, columns, tz, settings), [*naive, *wanted], progress)


def _run(df: Frame, settings: Settings, contenders: Sequence[Contender], progress: bool) -> Backtest:
    found = taken(settings, df)
    for sentence in found.warnings:
        warnings.warn(sentence, stacklevel=3)
    if not found.samples:
        raise DataError("no row of the table could be used; look at its times and units")
    recording, seed = of_record(record_of(found.samples, settings.zone), settings.zone), settings.zone.seed
    runs: dict[str, Arrays] = {}
    try:
        with Progress("backtest", len(contenders), progress, "estimators") as bar:
            for one in contenders:
                (job,) = jobs_of(one, recording, (seed,))
                runs[one.label] = job.work(job.payload)
                bar.update()
    except EstimatorError as error:
        raise ConfigError([f"estimators: {one.label}: {error}"]) from None
    return Backtest(recording, runs, settings.tz)


def _short(horizon: str) -> str:
    """A horizon as `Model.skill` calls it."""
    return horizon.replace(" h", "h")
