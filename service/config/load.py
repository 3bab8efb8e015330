"""Reading the configuration file, and explaining everything that is wrong with it at once."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from adapters.channel import ChannelConfig, SourceConfig, UnboundChannel
from adapters.csv.parquet import is_parquet, parquet_columns
from adapters.errors import SourceError
from adapters.fields.durations import DAY
from adapters.fields.problems import Model, Place, Problems, unknown_key
from adapters.fields.values import identifier
from adapters.fields.words import shown, suggestion
from adapters.kinds import SOURCE_KINDS
from adapters.units import default_valid_range
from adapters.weather.config import WEATHER_KINDS, WeatherConfig
from estimator.network.network import Network
from service.config.checks import (
    ZoneDraft,
    check_ids,
    check_polled,
    check_sources,
    check_use,
    check_weather,
    check_zone,
)
from service.config.fleet import FleetConfig
from service.config.http import HttpConfig
from service.config.known_heat import heated, shared
from service.config.log import LogConfig
from service.config.network_tables import PresetConfig
from service.config.networks import proposes_bounds, read_network
from service.config.overrides import apply_overrides
from service.config.resumed import resumed
from service.config.site import TABLES, Config, SiteConfig, Whereabouts, ZoneConfig, ZoneTable
from service.errors import ConfigError
from service.publish.kinds import SINK_KINDS
from service.zone.aggregation import default_aggregate
from service.zone.alignment import SETPOINT, unit_of

MOST_LEVELS = 50
"""Tables and lists in each other that are looked into; no key takes as many."""


def load(path: Path, overrides: Sequence[str] = ()) -> Config:
    """The configuration in the file at `path`, with `overrides` ("dotted.key=value") applied.

    Every default is filled in and every path absolute (relative ones are taken from the file's folder). Nothing is
    connected to, but the headers of recorded files are read. Raises ConfigError with every mistake found, one sentence
    each.
    """
    raw = apply_overrides(_parsed(path), overrides)
    return _read(raw, path.resolve().parent, Problems(raw))


def load_history(path: Path, history: Path, overrides: Sequence[str] = ()) -> Config:
    """The configuration at `path` with the [sources], and of every zone the channels and set-point, of the file
    `history` in place of its own; other zones are left out. A set-point that is a schedule stays where `history` has
    none. A Parquet file is history itself: its columns are called `zone/channel`, or `channel` where there is one zone
    only. Raises ConfigError with every mistake found, by its place in `history`."""
    checked = load(path, overrides)
    plant = apply_overrides(_parsed(path), overrides)
    told, unused = _from_parquet(history, plant) if is_parquet(history) else (_parsed(history), [])
    problems = Problems(told)
    if unused:
        problems.warn(("sources", _HISTORY), f"no channel is called like its columns {', '.join(unused)}")
    for key in told:
        if key not in _OF_HISTORY:
            problems.add((key,), f"does not belong into a history; it has {' and '.join(_OF_HISTORY)} only")
    zones = [
        _with_history(table, ("zones", index), plant, checked, path, problems)
        for index, table in enumerate(_raw_zones(told, problems))
        if isinstance(table, dict)
    ]
    if problems.sentences:
        raise ConfigError(problems.sentences)
    # Relative paths are those of the folder of their own file.
    site = plant["site"] | {"state_dir": str(checked.site.state_dir)}
    sources = told.get("sources")
    if isinstance(sources, dict):
        sources = _schedules(plant, checked, zones) | sources
    raw = {"site": site, "sources": sources, "zones": zones}
    return _read(raw, history.resolve().parent, problems)


_OF_HISTORY = ("sources", "zones")
_OF_HISTORY_ZONES = ("id", "channels", SETPOINT)
_HISTORY = "history"
_OF_RECORDED = ("unit", "nominal", "aggregate", "valid", "max_age")
"""Keys of a channel that its history shares: the rest says how the live value is found."""


def _from_parquet(history: Path, plant: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """The Parquet file `history` as the tables of a history of `plant`, and its columns that are of no use; every value
    is in the unit of its channel."""
    try:
        columns = parquet_columns(history)
    except SourceError as error:
        raise ConfigError([str(error)]) from None
    times = [name for name, is_time in columns.items() if is_time]
    if len(times) != 1:
        raise ConfigError([f"{history}: it has {len(times)} columns of times, and needs one; write it again"])
    zones, used = list[dict[str, Any]](), {times[0]}
    for table in plant["zones"]:
        wanted = {**table["channels"], **({SETPOINT: table[SETPOINT]} if SETPOINT in table else {})}
        found = {}
        for name, channel in wanted.items():
            column = next((one for one in (f"{table['id']}/{name}", name) if one in columns), None)
            if column is not None and (column != name or len(plant["zones"]) == 1):
                shared = {key: channel[key] for key in _OF_RECORDED if key in channel}
                found[name] = {**shared, "source": _HISTORY, "column": column}
                used.add(column)
        if found:
            setpoint = {SETPOINT: found.pop(SETPOINT)} if SETPOINT in found else {}
            zones.append({"id": table["id"], "channels": found, **setpoint})
    if not zones:
        raise ConfigError(
            [f"{history}: no column is called like a channel, such as room/T_i; its columns are {', '.join(columns)}"]
        )
    zone = plant["site"].get("time_zone")
    timestamp = {"column": times[0], **({"zone": zone} if zone else {})}
    source = {"kind": "csv", "files": [str(history.resolve())], "timestamp": timestamp}
    return {"sources": {_HISTORY: source}, "zones": zones}, [name for name in columns if name not in used]


def _with_history(
    told: Mapping[str, Any], place: Place, plant: Mapping[str, Any], checked: Config, path: Path, problems: Problems
) -> dict[str, Any]:
    """The zone of `plant`, which is `checked`, that `told` at `place` names, with the telemetry of `told`."""
    foreign = f"does not belong into a history; a zone there has {', '.join(_OF_HISTORY_ZONES)}"
    for key in told:
        if key not in _OF_HISTORY_ZONES:
            problems.add((*place, key), foreign)
    id, channels = told.get("id"), told.get("channels")
    found = next((pair for pair in zip(plant["zones"], checked.zones, strict=True) if pair[1].id == id), None)
    if found is None:
        known = suggestion(id, [zone.id for zone in checked.zones], "its zones are")
        problems.add((*place, "id"), f"{path} has no zone {shown(id)}; {known}")
        return {}
    zone, network = found[0], found[1].network
    if isinstance(channels, dict):
        if set(zone["channels"]) != set(channels):
            own = ", ".join(zone["channels"])
            sentence = f"must name the same channels as zone {shown(id)} of {path}, which are {own}"
            problems.add((*place, "channels"), sentence)
        # The state belongs to a network with the share, which other zones may have a part in that have no history.
        shares = {name: {"share": network.parameters[at].typical} for name, at in network.shares.items()}
        tables = {name: table for name, table in channels.items() if isinstance(table, dict) and name in shares}
        told = {**told, "channels": {**channels, **{name: table | shares[name] for name, table in tables.items()}}}
    setpoint = found[1].setpoint
    if setpoint is not None and setpoint.known_values:
        told = {SETPOINT: zone[SETPOINT], **told}
    elif setpoint is not None and SETPOINT not in told:
        problems.warn(place, f"has no {SETPOINT}, which zone {shown(id)} of {path} has: its thermostat learns nothing")
    return {key: value for key, value in zone.items() if key not in _OF_HISTORY_ZONES} | dict(told)


def _schedules(plant: Mapping[str, Any], checked: Config, zones: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The sources of `plant`, which is `checked`, with the schedules that the set-points of the tables `zones` name."""
    points = [zone.setpoint for zone in checked.zones if zone.setpoint is not None]
    schedules = {point.source for point in points if point.known_values}
    named = [point.get("source") for zone in zones if isinstance(point := zone.get(SETPOINT), dict)]
    return {name: table for name, table in plant["sources"].items() if name in schedules and name in named}


def load_sources(path: Path, overrides: Sequence[str] = ()) -> dict[str, SourceConfig]:
    """The [sources] tables alone of the file at `path`, for whoever has no zones yet. Raises ConfigError."""
    raw = apply_overrides(_parsed(path), overrides)
    problems = Problems(raw)
    site = raw.get("site")
    context = {"folder": path.resolve().parent, "site": site.get("id") if isinstance(site, dict) else None}
    read = {name: _read_source(name, table, problems, context) for name, table in _raw_sources(raw, problems).items()}
    if problems.sentences:
        raise ConfigError(problems.sentences)
    return {name: table for name, table in read.items() if table is not None}


def _parsed(path: Path) -> dict[str, Any]:
    try:
        # A byte-order mark is what Windows editors put at the beginning.
        document = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
        if _is_deep(document):
            # As a list in a list without end; the key of a table may have as many parts.
            raise RecursionError
        return document
    except OSError as error:
        reason = "it is a folder" if isinstance(error, IsADirectoryError) else (error.strerror or str(error)).lower()
        raise ConfigError([f"{path}: cannot be read ({reason}); give the path of a configuration file"]) from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise ConfigError([f"{path}: line {line} is not UTF-8 text; save the file as UTF-8"]) from None
    except ValueError as error:
        raise ConfigError([f"{path}: {_syntax(str(error))}"]) from None
    except RecursionError:
        raise ConfigError([f"{path}: a value in it is nested too deeply; no key takes so many levels"]) from None


def _syntax(message: str) -> str:
    found = re.fullmatch(r"(.*) \((?:at )?(?:line (\d+), column (\d+)|(end of document))\)", message)
    if not found:
        return f"this is not TOML: {message}"
    what = found[1][0].lower() + found[1][1:]
    where = "the end of the file" if found[4] else f"line {found[2]}, column {found[3]}"
    return f"{where}: this is not TOML: {what}"


def _read(raw: Mapping[str, Any], folder: Path, problems: Problems) -> Config:
    """The configuration of the tables `raw`; ConfigError with what is in `problems`, and what is wrong beside."""
    for key in raw:
        if key not in TABLES:
            problems.add((key,), unknown_key(key, TABLES))
    site_table = raw.get("site")
    context = {"folder": folder, "site": site_table.get("id") if isinstance(site_table, dict) else None}
    site = None
    if site_table is None:
        problems.add(("site",), 'is missing; begin the file with [site] and a line such as id = "htwg"')
    else:
        site = problems.read(SiteConfig, site_table, ("site",), context)
    log = problems.read(LogConfig, raw.get("log", {}), ("log",), context)
    http = problems.read(HttpConfig, raw.get("http", {}), ("http",), context)
    fleet = problems.read(FleetConfig, raw["fleet"], ("fleet",), context) if "fleet" in raw else None
    sinks = {name: problems.read(kind.table, raw.get(name, {}), (name,), context) for name, kind in SINK_KINDS.items()}
    for name, table in sinks.items():
        for problem in table.problems() if table is not None else ():
            problems.add((name,), problem)
    raw_sources = _raw_sources(raw, problems)
    weather = _read_weather(raw.get("weather", {}), problems, context)
    raw_zones = _raw_zones(raw, problems)
    sources = {name: _read_source(name, table, problems, context) for name, table in raw_sources.items()}
    known = {name: (_kind(table), sources[name]) for name, table in raw_sources.items()}
    drafts = [read_zone(table, ("zones", index), known, problems, context) for index, table in enumerate(raw_zones)]
    check_ids(raw_zones, problems)
    whereabouts = Whereabouts() if site is None else site.whereabouts
    for draft in drafts:
        if draft.table is not None and draft.network is not None:
            draft.network = heated(draft.network, draft.table, whereabouts, draft.place, problems)
    shared(drafts, problems)
    options = [check_zone(draft, {name: kind for name, (kind, _) in known.items()}, problems) for draft in drafts]
    check_weather(weather, drafts, problems)
    if raw_zones:
        check_use(list(raw_sources), raw_zones, problems)
    readable = {name: table for name, table in sources.items() if table is not None}
    check_sources(readable, drafts, problems)
    check_polled(readable, drafts, problems)
    if problems.sentences or site is None or log is None or http is None:
        raise ConfigError(problems.sentences)
    zones = tuple(
        completed(draft.table, draft.network, resolved, whereabouts)
        for draft, resolved in zip(drafts, options, strict=True)
        if draft.table and draft.network
    )
    config = Config(
        site=site,
        log=log,
        http=http,
        sinks=sinks,
        sources=readable,
        zones=resumed(zones, site.state_dir),
        weather={name: table for name, table in weather.items() if table is not None},
        warnings=tuple(problems.warnings),
        fleet=fleet,
    )
    if wrong := [problem for name in config.weather for problem in config.build_weather(name).check()]:
        raise ConfigError(wrong)
    return config


def _raw_sources(raw: Mapping[str, Any], problems: Problems) -> Mapping[str, Any]:
    tables = raw.get("sources")
    if isinstance(tables, dict) and tables:
        return tables
    example = 'add a table such as [sources.recording] with kind = "csv" that says where readings come from'
    wrong = "is missing" if not tables and isinstance(tables, dict | None) else f"must be tables, not {shown(tables)}"
    problems.add(("sources",), f"{wrong}; {example}")
    return {}


def _raw_zones(raw: Mapping[str, Any], problems: Problems) -> Sequence[Any]:
    tables = raw.get("zones")
    if isinstance(tables, list) and tables:
        return tables
    if isinstance(tables, dict):
        problems.add(("zones",), "must be written with double brackets, [[zones]], once for every zone")
    elif tables:
        problems.add(("zones",), f"must be [[zones]] tables, one for every zone, not {shown(tables)}")
    else:
        problems.add(("zones",), "there is no zone; add a [[zones]] table for every zone")
    return []


def _read_source(name: str, table: Any, problems: Problems, context: Mapping[str, Any]) -> SourceConfig | None:
    place: Place = ("sources", name)
    try:
        identifier(name)
    except ValueError as error:
        problems.add(place, str(error))
    return _of_its_kind(table, place, SOURCE_KINDS, "source", problems, {**context, "source": name})


def _read_weather(tables: Any, problems: Problems, context: Mapping[str, Any]) -> dict[str, WeatherConfig | None]:
    if not isinstance(tables, dict):
        problems.add(("weather",), f"must be tables such as [weather.forecast], not {shown(tables)}")
        return {}
    return {
        name: _of_its_kind(table, ("weather", name), WEATHER_KINDS, "forecast", problems, context)
        for name, table in tables.items()
    }


def _of_its_kind(
    table: Any,
    place: Place,
    kinds: Mapping[str, type[Model]],
    what: str,
    problems: Problems,
    context: Mapping[str, Any],
) -> Model | None:
    """The table of a `what`, at `place`, as the model of its kind; None, with its mistakes noted, if it has any."""
    names = ", ".join(kinds)
    if not isinstance(table, dict):
        problems.add(place, f"must be a table with kind ({names}) and what belongs to it, not {shown(table)}")
        return None
    kind = table.get("kind")
    if kind is None:
        problems.add((*place, "kind"), f"is missing; give the kind of {what}, one of: {names}")
    elif not isinstance(kind, str) or kind not in kinds:
        known = suggestion(kind, kinds, "the kinds are")
        problems.add((*place, "kind"), f"there is no {what} of kind {shown(kind)}; {known}")
    else:
        return problems.read(kinds[kind], table, place, context)
    return None


Known = Mapping[str, tuple[str | None, SourceConfig | None]]
"""The sources by name: kind and table, each None if it could not be read."""


def _kind(table: Any) -> str | None:
    """The kind of the source that `table` describes; None if there is no such kind."""
    kind = table.get("kind") if isinstance(table, dict) else None
    return kind if isinstance(kind, str) and kind in SOURCE_KINDS else None


def _read_channel(
    table: Any, place: Place, sources: Known, problems: Problems, context: Mapping[str, Any]
) -> ChannelConfig | None:
    """The channel in `table`, with what it takes over from its source, read by the kind of that source."""
    name = table.get("source") if isinstance(table, dict) else None
    kind, source = sources.get(name, (None, None)) if isinstance(name, str) else (None, None)
    if kind is None and name is not None and place[-1] == SETPOINT:
        # What is wrong is the source; a schedule would say the unit.
        table = {"unit": "degC"} | table
    channel = problems.read(UnboundChannel if kind is None else SOURCE_KINDS[kind].channel, table, place, context)
    if channel is None or source is None:
        return channel
    try:
        return channel.within(source)
    except ValueError as error:
        problems.add(place, str(error))
        return None


def read_zone(table: Any, place: Place, sources: Known, problems: Problems, context: Mapping[str, Any]) -> ZoneDraft:
    """Read a zone part by part, so that a mistake in one part does not hide those in another."""
    if not isinstance(table, dict):
        problems.add(place, f"must be a [[zones]] table, not {shown(table)}")
        return ZoneDraft(place, None, None, None, {})
    rest = dict(table)
    network: Network | None = None
    if "network" in table:
        named = table["channels"] if isinstance(table.get("channels"), dict) else ()
        described, network = read_network(table["network"], (*place, "network"), problems, context, tuple(named))
        # What is wrong with it has been said; the rest of the zone is read as if it were right.
        rest["network"] = described or PresetConfig(preset="tite")
    channels: dict[str, ChannelConfig] = {}
    names: tuple[str, ...] | None = None
    if isinstance(table.get("channels"), dict):
        names = tuple(table["channels"])
        read = {
            name: _read_channel(channel, (*place, "channels", name), sources, problems, context)
            for name, channel in table["channels"].items()
        }
        channels = {name: channel for name, channel in read.items() if channel is not None}
        rest["channels"] = channels
    setpoint = None
    if "setpoint" in table:
        setpoint = _read_channel(table["setpoint"], (*place, SETPOINT), sources, problems, context)
        rest["setpoint"] = setpoint
    return ZoneDraft(place, problems.read(ZoneTable, rest, place, context), network, names, channels, setpoint)


def completed(zone: ZoneTable, network: Network, options: object, whereabouts: Whereabouts) -> ZoneConfig:
    """The checked `zone` of a site, with the defaults of aggregate and valid range that depend on its network."""
    channels = {
        name: _filled(channel, network.channel_unit(name), name == network.clouds)
        for name, channel in zone.channels.items()
    }
    setpoint = None if zone.setpoint is None else _filled(zone.setpoint, unit_of(network, SETPOINT))
    written = {name: getattr(zone, name) for name in ZoneTable.model_fields}
    resolved = {"network": network, "options": options, "proposes_bounds": proposes_bounds(zone.network)}
    resolved |= {"whereabouts": whereabouts}
    values = written | resolved | {"channels": channels, "setpoint": setpoint}
    return ZoneConfig.model_construct(_fields_set=zone.model_fields_set | set(resolved), **values)


def _filled(channel: ChannelConfig, unit: str, clouds: bool = False) -> ChannelConfig:
    """`channel` with the defaults that depend on the network's `unit` for it, and on whether it is that of `clouds`:
    services tell these every hour or less often, and those of some hours ago say more than none."""
    defaults: dict[str, Any] = {}
    if channel.valid is None and channel.aggregate != "energy":
        defaults["valid"] = (0.0, 100.0) if clouds else default_valid_range(unit)
    if channel.max_age is None and clouds:
        defaults["max_age"] = DAY
    if "aggregate" not in channel.model_fields_set:
        defaults["aggregate"] = default_aggregate(unit, channel.unit)
    return channel.model_copy(update=defaults)


def _is_deep(document: object) -> bool:
    """Whether there is a value below more than MOST_LEVELS tables and lists."""
    found = [document]
    for _ in range(MOST_LEVELS):
        inner = ((one.values() if isinstance(one, dict) else one) for one in found if isinstance(one, dict | list))
        found = list(chain.from_iterable(inner))
    return bool(found)
