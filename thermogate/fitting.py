"""`fit` and `load`: where a model comes from."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from datetime import timedelta, tzinfo
from os import PathLike
from pathlib import Path
from typing import Any

from estimator.network.network import Network
from service.records.outlook import SET_POINTS
from thermogate.arguments import duration, items, plain
from thermogate.files import read_model
from thermogate.frames import Frame, clock, pandas, spacing
from thermogate.learning import learn
from thermogate.model import Model
from thermogate.session import Session
from thermogate.settings import network_of, settings_of


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
    habits: bool | None = None,
    sun: str | bool | None = None,
    floor_area: float | None = None,
    latitude: float | None = None,
    longitude: float | None = None,
    country: str | None = None,
    progress: bool = True,
) -> Model:
    """Learn the thermal model of a zone from a table of measurements, as the daemon would have learned it online.

    Args:
        df: a DataFrame with a DatetimeIndex; rows need no order and no even spacing.
        network: a preset such as "titeth", "auto" for one that follows from the columns, a table as in
            [zones.network], or a `Network`.
        columns: what a channel is read from, where the column does not have its name and unit: the name of a column, a
            pair of name and unit such as ("Heating kW", "kW"), or a table as in [zones.channels]. "T_set" is what the
            room is meant to have; a column of that name is taken for it.
        tz: the time zone of an index without one; otherwise that of the results. A name such as "Europe/Berlin", an
            offset such as "UTC+02:00", or a tzinfo that has one of the two.
        period: the sampling period, such as "15min"; None takes the usual distance of the rows.
        estimator, estimator_options, levels, max_gap, hold_inputs: as in [[zones]]; None is the daemon's default.
        habits: whether people heat the zone every day at the same hours; None: for the network "auto".
        sun: "facades", which needs `latitude` and `longitude`, "hours", or False; None: as the network "auto" can.
        floor_area: of the zone [m2], which scales what is thought of it before the first sample.
        latitude, longitude: of the building, in degrees, north and east positive.
        country: whose public holidays are as weekends, such as "DE" or "DE-BW".
        seed: of the random numbers; the same seed gives the same bits.
        progress: whether a fit of more than two seconds shows a progress bar.

    Raises ConfigError for arguments and DataError for a table that cannot be used.
    """
    pandas()
    tables, published = {} if columns is None else items(columns), items(levels)
    present = set(map(str, getattr(df, "columns", ())))
    if isinstance(tables, Mapping) and SET_POINTS in present:
        tables = {SET_POINTS: SET_POINTS, **tables}
    resolved = network_of(plain(network), present.union(map(str, tables if isinstance(tables, Mapping) else ())))
    times = clock(df, tz, "the table")
    given: dict[str, Any] = {
        "period": spacing(times.seconds) if period is None else duration(period),
        "estimator": plain(estimator),
        "estimator_options": items(estimator_options),
        "seed": plain(seed),
        "levels": [published] if isinstance(published, int | float) else published,
        "max_gap": plain(max_gap),
        "hold_inputs": duration(hold_inputs),
        "habits": plain(habits),
        "sun": plain(sun),
        "floor_area": plain(floor_area),
        "latitude": plain(latitude),
        "longitude": plain(longitude),
        "country": plain(country),
    }
    known = {name: value for name, value in given.items() if value is not None}
    settings = settings_of(resolved, tables, times.zone, known)
    used = {name for column in settings.columns for name in column.sources}
    others = tuple(name for name in map(str, df.columns) if name not in used)
    session = Session(settings._replace(other_columns=others))
    learned = learn(session, df, progress, "fit")
    for sentence in learned.warnings:
        warnings.warn(sentence, stacklevel=2)
    return Model(session, learned.faults)


def load(path: str | PathLike[str]) -> Model:
    """The model that `Model.save` wrote to `path`; it goes on with the same bits. DataError for any other file."""
    return Model(*read_model(Path(path)))
