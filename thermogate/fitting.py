"""`fit` and `load`: where a model comes from."""

import warnings
from collections.abc import Mapping, Sequence
from datetime import timedelta, tzinfo
from os import PathLike
from pathlib import Path
from typing import Any

from estimator.network.network import Network
from estimator.network.presets import AUTO
from thermogate.files import read_model, read_zone
from thermogate.frames import Frame
from thermogate.learning import learn
from thermogate.model import Model
from thermogate.session import Session
from thermogate.settings import settings_for


def fit(
    df: Frame,
    network: str | Mapping[str, Any] | Network = AUTO,
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
    construction: str | None = None,
    built: int | None = None,
    use: str | None = None,
    latitude: float | None = None,
    longitude: float | None = None,
    country: str | None = None,
    neighbours: Sequence[Model] = (),
    progress: bool = True,
) -> Model:
    """Learn the thermal model of a zone from a table of measurements, as the daemon would have learned it online.

    Args:
        df: a DataFrame with a DatetimeIndex; rows need no order and no even spacing.
        network: "auto" for one that follows from the columns, a preset such as "titeth", a table as in [zones.network],
            or a `Network`.
        columns: what a channel is read from, where the column does not have its name and unit: the name of a column, a
            pair of name and unit such as ("Heating kW", "kW"), or a table as in [zones.channels]. "T_set" is what the
            room is meant to have; a column of that name is taken for it.
        tz: the time zone of an index without one; otherwise that of the results. A name such as "Europe/Berlin", an
            offset such as "UTC+02:00", or a tzinfo that has one of the two.
        period: the sampling period, such as "15min"; None takes the usual distance of the rows.
        estimator, estimator_options, levels, max_gap, hold_inputs: as in [[zones]]; None is the daemon's default.
        habits: whether people heat the zone every day at the same hours; None: for the network "auto".
        sun: "facades", which needs `latitude` and `longitude`, as does "clear-sky", which needs no sensor, and takes
            clouds [%] from a column cloud_cover; "hours", or False; None: as the network "auto" can.
        floor_area: of the zone [m2], which scales what is thought of it before the first sample.
        construction, built, use: how heavy the building is, such as "heavy", its year, and what the zone is used for,
            such as "office", as in [[zones]]; facts of public studies then inform the first days.
        latitude, longitude: of the building, in degrees, north and east positive.
        country: whose public holidays are as weekends, such as "DE" or "DE-BW".
        neighbours: models of other rooms of the building; this one begins with what they have learned.
        seed: of the random numbers; the same seed gives the same bits.
        progress: whether a fit of more than two seconds shows a progress bar.

    Raises ConfigError for arguments and DataError for a table that cannot be used.
    """
    settings = settings_for(
        df,
        network,
        columns,
        tz,
        {
            "period": period,
            "estimator": estimator,
            "estimator_options": estimator_options,
            "seed": seed,
            "levels": levels,
            "max_gap": max_gap,
            "hold_inputs": hold_inputs,
            "habits": habits,
            "sun": sun,
            "floor_area": floor_area,
            "construction": construction,
            "built": built,
            "use": use,
            "latitude": latitude,
            "longitude": longitude,
            "country": country,
        },
    )
    session = Session(settings)
    session.begin([model._session for model in neighbours])
    learned = learn(session, df, progress, "fit")
    for sentence in learned.warnings:
        warnings.warn(sentence, stacklevel=2)
    return Model(session, learned.faults)


def load(path: str | PathLike[str], zone: str | None = None) -> Model:
    """The model that `Model.save` wrote to `path`; it goes on with the same bits. DataError for any other file.

    A folder is the state of a daemon, of which `zone` is wanted: what it has learned, with its history, as a copy. Its
    tables have columns called as the channels; `predictions` and the like begin with the newest checkpoint.
    """
    place = Path(path)
    return Model(*(read_zone(place, zone) if place.is_dir() else read_model(place)))
