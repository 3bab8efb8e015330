"""The arguments of `fit` as a checked zone: the same rules and defaults as in the configuration of the daemon."""

from collections.abc import Callable, Collection, Mapping
from datetime import tzinfo
from pathlib import Path
from typing import Any, NamedTuple
from zoneinfo import available_timezones

from adapters.fields.problems import Problems
from adapters.fields.words import shown, suggestion
from estimator.network.network import Network
from estimator.network.presets import AUTO, CLOUDS, automatic
from service.config.checks import check_zone
from service.config.known_heat import heated, shared
from service.config.load import completed, read_zone
from service.config.networks import read_network
from service.config.site import SiteConfig, Whereabouts, ZoneConfig
from service.errors import ConfigError
from service.records.outlook import SET_POINTS
from service.zone.alignment import SETPOINT, unit_of
from thermogate.arguments import duration, items, plain
from thermogate.frames import Column, Frame, clock, pandas, spacing

ZONE = "notebook"
"""The id of the zone, and the name of its source."""
PLACE = ("latitude", "longitude", "country")
"""Keys of a site among those that `fit` takes."""


class Settings(NamedTuple):
    """A zone, the zone of its times, and what it was made of."""

    zone: ZoneConfig
    tz: str
    given: Mapping[str, Any]
    """`period`, `estimator` and the other keys of a zone as they were given, and `columns` as tables."""
    other_columns: tuple[str, ...] = ()
    """Columns of the first table that the model does not use."""

    @property
    def columns(self) -> list[Column]:
        """What is read from a table: the channels of the network, and the set-point where there is one."""
        return [
            Column(SET_POINTS if name == SETPOINT else name, f"{ZONE}/{name}", table, unit_of(self.zone.network, name))
            for name, table in self.zone.delivered.items()
        ]

    @property
    def plannable(self) -> list[Column]:
        """Those of `columns` that a plan may name."""
        return [column for column in self.columns if column.name in (*self.zone.network.inputs, SET_POINTS)]


def settings_for(
    df: Frame, network: object, columns: object, tz: str | tzinfo | None, given: Mapping[str, Any]
) -> Settings:
    """The settings that the arguments of `fit` amount to for the table `df`; None in `given` leaves the default.

    ConfigError for arguments and DataError for a table that cannot be used.
    """
    pandas()
    tables = {} if columns is None else items(columns)
    present = set(map(str, getattr(df, "columns", ())))
    if isinstance(tables, Mapping) and SET_POINTS in present:
        tables = {SET_POINTS: SET_POINTS, **tables}
    if given.get("sun") != "clear-sky":
        # Tables of weather have such a column, with which alone nothing can be done.
        present.discard(CLOUDS)
    resolved = network_of(plain(network), present.union(map(str, tables if isinstance(tables, Mapping) else ())))
    times = clock(df, tz, "the table")
    if given.get("period") is None:
        given = {**given, "period": spacing(times.seconds)}
    known = {name: _AS.get(name, plain)(value) for name, value in given.items() if value is not None}
    settings = settings_of(resolved, tables, times.zone, known)
    used = {name for column in settings.columns for name in column.sources}
    return settings._replace(other_columns=tuple(name for name in map(str, df.columns) if name not in used))


def _listed(value: object) -> object:
    """`value` as a list, where it is a number alone."""
    found = items(value)
    return [found] if isinstance(found, int | float) else found


_AS: Mapping[str, Callable[[Any], Any]] = {
    "period": duration,
    "hold_inputs": duration,
    "estimator_options": items,
    "levels": _listed,
}
"""How an argument is read that can be written in several ways."""


def network_of(network: object, channels: Collection[str] = ()) -> Network:
    """A preset's name, a table as in the configuration or a network, as a network; "auto" follows from the `channels`
    that there are columns for. ConfigError with the mistakes."""
    if isinstance(network, Network):
        return network.validate()
    raw = {"network": dict(network) if isinstance(network, Mapping) else network}
    problems = Problems(raw)
    found = read_network(raw["network"], ("network",), problems, {}, channels)[1]
    if problems.sentences or found is None:
        raise ConfigError(problems.sentences)
    return found


def settings_of(
    network: Network, columns: Mapping[str, Any], tz: str, given: Mapping[str, Any], *, stored: bool = False
) -> Settings:
    """The checked settings; `given` has keys of a zone, and PLACE of the site, whose sun, habits and priors a `stored`
    network has already, or is to go on without. ConfigError with every mistake."""
    tables = _column_tables(network, columns)
    problems = Problems({**given, "channels": tables})
    place_table = {name: given[name] for name in PLACE if name in given}
    site = problems.read(SiteConfig, {"id": ZONE, "time_zone": _named(tz), **place_table}, (), {"folder": Path()})
    whereabouts = Whereabouts() if site is None else site.whereabouts
    described = {name: value for name, value in given.items() if name not in PLACE}
    channels = {name: {**written, "source": ZONE} for name, written in tables.items()}
    if SET_POINTS in channels and SET_POINTS not in network.channels:
        described[SETPOINT] = channels.pop(SET_POINTS)
    # The network is checked; a preset stands for it where the table asks for one.
    described |= {"id": ZONE, "network": "tite", "channels": channels}
    draft = read_zone(described, (), {ZONE: ("csv", None)}, problems, {"site": ZONE, "folder": Path()})
    table = None if stored else draft.table
    draft.network = network if table is None else heated(network, table, whereabouts, (), problems)
    shared([draft], problems)
    options = check_zone(draft, {}, problems)
    if problems.sentences or draft.table is None:
        raise ConfigError([_as_columns(sentence) for sentence in problems.sentences])
    return Settings(completed(draft.table, draft.network, options, whereabouts), tz, {**given, "columns": tables})


def _named(tz: str) -> str | None:
    """A time zone with a name; None for a fixed offset, whose hours `calendar` takes from the sun."""
    return tz if tz in available_timezones() else None


def _column_tables(network: Network, columns: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """One table per channel, as in [zones.channels]; a channel that is not named is the column with its name."""
    if not isinstance(columns, Mapping):
        raise ConfigError([f'columns must be a dict such as {{"T_i": "Room"}}, not {shown(columns)}'])
    problems, tables = [], {}
    known = dict.fromkeys((*network.channels, *([SET_POINTS] if SET_POINTS in columns else ())))
    for name in columns:
        if name not in known:
            near = suggestion(name, network.channels, "its channels are")
            problems.append(
                f"columns.{name}: network {shown(network.name)} has no such channel; {near}{with_auto(name)}"
            )
    for name in known:
        unit = network.channel_unit(name) if name in network.channels else unit_of(network, SETPOINT)
        written = columns.get(name, name)
        if isinstance(written, str):
            tables[name] = {"column": written, "unit": unit}
        elif isinstance(written, tuple) and len(written) == 2 and all(isinstance(part, str) for part in written):
            tables[name] = {"column": written[0], "unit": written[1]}
        elif isinstance(written, Mapping):
            own = {} if "columns" in written else {"column": name}
            tables[name] = {**own, "unit": unit, **written}
        else:
            problems.append(
                f"columns.{name}: must be the name of a column, a pair of name and unit such as "
                f'("{name}", "{unit}"), or a table as in [zones.channels], not {shown(written)}'
            )
    if problems:
        raise ConfigError(problems)
    return tables


def with_auto(channel: str) -> str:
    """How a sentence goes on about a channel that another network does not have; nothing where "auto" has none such."""
    known = channel in automatic([channel]).channels
    return f'; use network="{AUTO}", which takes {channel} where there is a column for it' if known else ""


def _as_columns(sentence: str) -> str:
    """A sentence about a channel of the configuration, with the place where a caller wrote it."""
    for place, column in (("channels.", ""), (SETPOINT, SET_POINTS)):
        if sentence.startswith(place):
            return f"columns.{column}{sentence.removeprefix(place)}"
    return sentence
