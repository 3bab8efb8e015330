"""Checks across the tables of a configuration: names must meet, units convert, files be there."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from adapters.channel import Binding, ChannelConfig, SourceConfig
from adapters.errors import SourceError
from adapters.fields.durations import format_duration
from adapters.fields.problems import Place, Problems
from adapters.fields.words import shown, suggestion
from adapters.kinds import SOURCE_KINDS
from adapters.units import ENERGIES, conversion, default_valid_range, possible_range
from estimator.errors import OptionsError
from estimator.network.network import Network
from estimator.network.presets import AUTO
from estimator.registry import ESTIMATORS, resolve
from service.config.site import ZoneTable
from service.records.outlook import SET_POINT_RANGE
from service.zone.aggregation import AGGREGATES, default_aggregate
from service.zone.alignment import SETPOINT, unit_of

_MORE_CHANNELS = "; it also takes I_sol for the sun, or else cloud_cover, and neighbours whose names begin with T_adj"


@dataclass
class ZoneDraft:
    """What could be read of one zone; each part is there or not independently of the others.

    `names` are the channels as written (None: not even those), `channels` those among them that could be read.
    """

    place: Place
    table: ZoneTable | None
    network: Network | None
    names: tuple[str, ...] | None
    channels: Mapping[str, ChannelConfig]
    setpoint: ChannelConfig | None = None

    @property
    def delivered(self) -> Iterator[tuple[Place, str, ChannelConfig]]:
        """Every channel that could be read with its place, the set-point among them."""
        for name, channel in self.channels.items():
            yield (*self.place, "channels", name), name, channel
        if self.setpoint is not None:
            yield (*self.place, SETPOINT), SETPOINT, self.setpoint

    def unit(self, name: str) -> str | None:
        """The network's unit for one of its channels or the set-point; None for a name that it does not know."""
        if self.network is None or name not in (*self.network.channels, SETPOINT):
            return None
        return unit_of(self.network, name)


def check_ids(raw_zones: Sequence[Any], problems: Problems) -> None:
    """No two zones share an id."""
    first: dict[str, int] = {}
    for index, zone in enumerate(raw_zones):
        name = zone.get("id") if isinstance(zone, dict) else None
        if isinstance(name, str) and first.setdefault(name, index) != index:
            sentence = f"{shown(name)} is already the id of zones[{first[name]}]; give every zone an id of its own"
            problems.add(("zones", index, "id"), sentence)


def check_zone(draft: ZoneDraft, kinds: Mapping[str, str | None], problems: Problems) -> object:
    """The resolved options of a zone, None where they do not hold; what else is wrong with its channels is noted.
    `kinds` maps the name of every source to its kind, None if that could not be read."""
    options = None
    if draft.network is not None:
        _check_channel_names(draft, draft.network, kinds, problems)
        if draft.table is not None:
            options = _resolved_options(draft.place, draft.table, draft.network, problems)
    _check_mixture(draft, kinds, problems)
    if draft.setpoint is not None and draft.network is not None and SETPOINT in draft.network.channels:
        problems.add((*draft.place, SETPOINT), "is also the name of a channel of the network; rename that channel")
        return options
    for place, name, channel in draft.delivered:
        if kinds and channel.source not in kinds:
            known = suggestion(channel.source, kinds, "the sources are")
            problems.add((*place, "source"), f"there is no source {shown(channel.source)}; {known}")
        if channel.aggregate not in AGGREGATES:
            known = suggestion(channel.aggregate, AGGREGATES, "the aggregates are")
            problems.add((*place, "aggregate"), f"{shown(channel.aggregate)} is not known; {known}")
        unit = draft.unit(name)
        wrong_unit = _unit_problem(unit, channel)
        if wrong_unit:
            problems.add((*place, "unit"), wrong_unit)
        elif unit is not None:
            _check_use_of_energy(place, channel, unit, problems)
            lower, upper = possible_range(unit)
            if channel.valid is not None and not (lower <= channel.valid[0] and channel.valid[1] <= upper):
                sentence = (
                    f"{shown(channel.valid)} goes beyond what can be in {unit}; stay within {lower:g} to {upper:g}"
                )
                problems.add((*place, "valid"), sentence)
            _check_known_values(place, name, channel, unit, problems)
        if draft.network is not None and name in draft.network.measured and channel.max_age is not None:
            problems.add(
                (*place, "max_age"), "is for inputs, which may be held; a measured temperature never is, remove it"
            )
        if name == SETPOINT and channel.forecast is not None:
            problems.add((*place, "forecast"), "is for inputs; nothing is forecast of a set-point, remove it")
    return options


def check_sources(tables: Mapping[str, SourceConfig], drafts: Sequence[ZoneDraft], problems: Problems) -> None:
    """Every source can be opened and has the columns that the zones ask of it."""
    for name, table in tables.items():
        bindings = [binding for draft in drafts for binding in _bindings(name, draft)]
        try:
            problems.sentences += table.build(name, bindings).check()
        except SourceError as error:
            problems.add(("sources", name), str(error))


def check_polled(tables: Mapping[str, SourceConfig], drafts: Sequence[ZoneDraft], problems: Problems) -> None:
    """Warn of channels of which, by default, the first of many live readings counts, though they are no switches."""
    for draft in drafts:
        if draft.network is None or draft.table is None:
            continue
        for name, channel in draft.channels.items():
            source = tables.get(channel.source)
            if source is None or not source.live or name not in draft.network.channels:
                continue
            rule = default_aggregate(draft.network.channel_unit(name), channel.unit)
            many = getattr(source, "poll", 0.0) < draft.table.period
            if rule == "first" and many and not channel.switched and "aggregate" not in channel.model_fields_set:
                problems.warn(
                    (*draft.place, "channels", name),
                    f"the first reading of every {format_duration(draft.table.period)} counts and the others do not, "
                    'which suits power that is switched; write aggregate = "mean" if it varies, or "first" if not',
                )


def check_weather(tables: Mapping[str, Any], drafts: Sequence[ZoneDraft], problems: Problems) -> None:
    """Every forecast that a channel names is there and in a unit that converts, and every table is named."""
    used = set()
    for draft in drafts:
        for name, channel in draft.channels.items():
            place, told = (*draft.place, "channels", name, "forecast"), channel.forecast
            if told is None:
                continue
            used.add(told.source)
            if told.source not in tables:
                known = ", ".join(tables) or "none"
                problems.add(
                    (*place, "source"), f"there is no [weather.{told.source}] table; the forecasts are: {known}"
                )
            if draft.network is None or name not in draft.network.channels:
                continue
            if name not in draft.network.inputs:
                problems.add(place, "is for inputs; what is measured in the zone is forecast by the zone, remove it")
                continue
            try:
                unit = draft.network.channel_unit(name)
                conversion(told.unit or unit, unit)
            except SourceError as error:
                problems.add((*place, "unit"), str(error))
    for name in tables:
        if name not in used:
            problems.add(("weather", name), "is not used; remove it, or name it in the forecast of a channel")


def check_use(source_names: Sequence[str], raw_zones: Sequence[Any], problems: Problems) -> None:
    """Warn of sources that no channel names, be that channel otherwise right or wrong."""
    used = set()
    for zone in raw_zones:
        table = zone if isinstance(zone, dict) else {}
        channels = table.get("channels")
        for channel in (*(channels.values() if isinstance(channels, dict) else ()), table.get(SETPOINT)):
            used.add(str(channel.get("source")) if isinstance(channel, dict) else None)
    for name in source_names:
        if name not in used:
            sentence = "is not used by any zone and stays off; remove it, or name it as the source of a channel"
            problems.warn(("sources", name), sentence)


def _bindings(source: str, draft: ZoneDraft) -> list[Binding]:
    zone = draft.table.id if draft.table is not None else f"zones[{draft.place[-1]}]"
    return [
        Binding(f"{zone}/{name}", channel, unit)
        for _, name, channel in draft.delivered
        if channel.source == source and (unit := draft.unit(name)) is not None and not _unit_problem(unit, channel)
    ]


def _check_channel_names(
    draft: ZoneDraft, network: Network, kinds: Mapping[str, str | None], problems: Problems
) -> None:
    place = (*draft.place, "channels")
    kind = next((kind for kind in kinds.values() if kind is not None), "csv")
    if draft.names is None:
        return
    for name in draft.names:
        if name not in network.channels:
            known = suggestion(name, network.channels, "its channels are")
            more = _MORE_CHANNELS if network.name == AUTO else ""
            problems.add((*place, name), f'network "{network.name}" has no such channel; {known}{more}')
    for name in network.channels:
        if name not in draft.names:
            unit, example = network.channel_unit(name), SOURCE_KINDS[kind].example
            line = f'{name} = {{ source = "...", {example}, unit = "{unit}" }}'
            problems.add((*place, name), f'is missing; network "{network.name}" needs it, so add a line such as {line}')


def _check_mixture(draft: ZoneDraft, kinds: Mapping[str, str | None], problems: Problems) -> None:
    """No zone mixes live and recorded sources."""
    sources = dict.fromkeys(channel.source for _, _, channel in draft.delivered if not channel.known_values)
    known = {name: kind for name in sources if (kind := kinds.get(name)) is not None}
    live = [name for name, kind in known.items() if SOURCE_KINDS[kind].live]
    recorded = [name for name in known if name not in live]
    if live and recorded:
        sentence = (
            f"mix live telemetry ({', '.join(live)}) with recorded telemetry ({', '.join(recorded)}), "
            "whose clocks differ; feed a zone from live sources only, or from recorded ones only"
        )
        problems.add((*draft.place, "channels"), sentence)


def _check_known_values(place: Place, name: str, channel: ChannelConfig, unit: str, problems: Problems) -> None:
    """A schedule has what may be planned of a set-point, and else what would be believed if it were measured."""
    if channel.known_values and name != SETPOINT:
        sentence = f"has the values of {channel.address}, which are planned, not measured; name what measures it"
        problems.warn(place, sentence)
    lower, upper = channel.valid or (SET_POINT_RANGE if name == SETPOINT else default_valid_range(unit))
    edge = channel.edge(unit)
    wrong = [raw for raw in channel.known_values if not lower <= edge.value(raw) <= upper]
    if wrong:
        sentence = (
            f"{channel.address} has {wrong[0]:g} {channel.unit}, which is not within {lower:g} to {upper:g} {unit}; "
            "correct the value or the unit, or give the channel's valid"
        )
        problems.add(place, sentence)


def _check_use_of_energy(place: Place, channel: ChannelConfig, unit: str, problems: Problems) -> None:
    energy = channel.unit in ENERGIES and channel.unit != unit
    if channel.aggregate == "energy" and not energy:
        known = ", ".join(ENERGIES)
        problems.add((*place, "aggregate"), f'"energy" adds up amounts of energy; the unit must be one of {known}')
    if channel.aggregate == "energy" and channel.valid is not None:
        problems.add((*place, "valid"), "is a range of power, which amounts of energy do not have; remove it")
    if channel.rollover is not None and not (energy and channel.aggregate != "energy"):
        problems.add((*place, "rollover"), f"is for counters of energy, in one of {', '.join(ENERGIES)}; remove it")
    if channel.installed is not None and unit not in ("W", "kW"):
        problems.add(
            (*place, "installed"), "is the largest power that can be planned, for a channel of power; remove it"
        )
    if channel.nominal is not None and not (channel.unit == "%" and unit != "%"):
        problems.add((*place, "nominal"), 'is the power at 100 %, for a channel of power in the unit "%"; remove it')


def _unit_problem(unit: str | None, channel: ChannelConfig) -> str | None:
    """Why the values of `channel` cannot become the network's `unit`, where that is known."""
    try:
        if unit is not None:
            conversion(channel.unit, unit, channel.nominal)
    except SourceError as error:
        return str(error)
    return None


def _resolved_options(place: Place, zone: ZoneTable, network: Network, problems: Problems) -> object:
    if zone.estimator not in ESTIMATORS:
        known = suggestion(zone.estimator, ESTIMATORS, "the estimators are")
        problems.add((*place, "estimator"), f"there is no estimator {shown(zone.estimator)}; {known}")
        return None
    given = dict(zone.estimator_options)
    while True:
        try:
            return resolve(zone.estimator, network, zone.period, given)
        except OptionsError as error:
            culprits = [name for name in error.options if name in given]
            problems.add((*place, "estimator_options", *culprits[:1]), str(error))
            if not culprits:
                return None
            # The others may be wrong as well.
            given = {name: value for name, value in given.items() if name not in culprits}
