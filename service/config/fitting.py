"""What a zone's configuration amounts to: its worker, its alignment, what is known of its inputs, the fingerprint of
its state, and what it begins with. The daemon and `thermogate replay` both build their zones here."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import islice
from math import ceil, nan

from adapters.channel import ChannelConfig
from adapters.timestamps import EARLIEST
from adapters.units import conversion, default_valid_range
from estimator import registry
from estimator.heat.known import KnownHeat
from estimator.neighbours import Experience, Learned, experience
from estimator.network.network import Network
from estimator.thermostat.futures import ToCome
from service.config.site import Config, Whereabouts, ZoneConfig
from service.records.outlook import SET_POINT_RANGE, SET_POINTS, Surroundings, WeatherLink
from service.store.checkpoint import Checkpoint, Checkpoints
from service.zone import snapshot
from service.zone.alignment import Alignment, Rules, unit_of
from service.zone.clock import PLAUSIBLE
from service.zone.local_time import calendar, kinds_of_day, offsets
from service.zone.worker import WorkerSettings, ZoneWorker

_MOST_EMPTY = 1000
"""Empty samples in a row at most, so that a clock set forward by years brings a moment's work. A worker that bridges
more makes up for them when telemetry comes again."""
_MOST_ASKED = 12
"""Neighbours that a zone asks at most; more would tell little that is new."""


def make_worker(zone: ZoneConfig) -> ZoneWorker:
    estimator = registry.construct(zone.estimator, zone.network, zone.period, zone.options)
    settings = WorkerSettings(
        zone.seed, zone.levels, zone.max_gap, zone.hold_inputs, zone.max_ages, zone.proposes_bounds
    )
    where, setpoint = zone.whereabouts, zone.setpoint
    local = calendar(where.time_zone, where.country, where.location)
    to_come = ToCome(kinds_of_day(local), None if setpoint is None else setpoint.foreknown("degC"), offsets(local))
    return ZoneWorker(estimator, settings, known_heat(estimator.network, zone.period, where), to_come)


def known_heat(network: Network, period: float, where: Whereabouts) -> KnownHeat | None:
    """The drive rows of `network` every `period` s; None where it has no terms."""
    if not network.terms:
        return None
    return KnownHeat(network, period, calendar(where.time_zone, where.country, where.location), where.location)


def make_alignment(
    zone: ZoneConfig, resume_after: int | None = None, live: bool = False, resume_idle: int = 0
) -> Alignment:
    """The alignment of `zone`, `live` or recorded, going on after the sample at `resume_after` if there is one, with
    which `resume_idle` samples in a row without a reading ended."""
    # A worker stalls once neither prediction nor held inputs bridge the silence; empty samples beyond that say nothing.
    longest = max(zone.hold_inputs, *zone.max_ages.values(), 0.0)
    bridged = min(max(zone.max_gap, ceil(longest / zone.period)) + 1, _MOST_EMPTY)
    held = None if zone.setpoint is None else zone.hold_inputs
    known = {name: table.foreknown(unit_of(zone.network, name)) for name, table in zone.delivered.items()}
    rules = Rules(
        {channel: table.aggregate for channel, table in zone.delivered.items()},
        zone=zone.id,
        lateness=zone.lateness,
        idle_limit=bridged,
        resume_after=resume_after,
        resume_idle=resume_idle,
        live=live,
        # Nothing that is dated by a clock that was never set is believed.
        earliest=PLAUSIBLE if live else EARLIEST,
        setpoint_age=held if zone.setpoint is None or zone.setpoint.max_age is None else zone.setpoint.max_age,
        known={name: values for name, values in known.items() if values is not None},
    )
    return Alignment(zone.network, zone.period, zone.sources, rules)


_Measured = Mapping[tuple[str, str], Sequence[tuple[str, str]]]
"""Zones and their outputs by where these are measured: source and address."""


def surroundings(config: Config) -> dict[str, Surroundings]:
    """What is known of the inputs of every zone, by its id."""
    measured: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for zone in config.zones:
        for output in zone.network.measured:
            channel = zone.channels[output]
            if channel.address:
                measured.setdefault((channel.source, channel.address), []).append((zone.id, output))
    return {zone.id: _surroundings(config, zone, measured) for zone in config.zones}


def _surroundings(config: Config, zone: ZoneConfig, measured: _Measured) -> Surroundings:
    network = zone.network
    inputs = {name: zone.channels[name] for name in network.inputs}
    return Surroundings(
        limits=plannable(zone),
        neighbours={
            name: one for name in network.boundaries if (one := _neighbour(measured, zone, inputs[name])) is not None
        },
        weather={
            name: _link(config, channel, network.channel_unit(name))
            for name, channel in inputs.items()
            if channel.forecast is not None
        },
        floor_area=nan if zone.floor_area is None else zone.floor_area,
        entered=power_entered(zone),
    )


def power_entered(zone: ZoneConfig) -> bool:
    """Whether the power of an input of `zone` at 100 % is entered, as of a valve."""
    return any(zone.channels[name].nominal is not None for name in zone.network.inputs)


def plannable(zone: ZoneConfig) -> dict[str, tuple[float, float]]:
    """What may be planned of each channel of `zone`, and of its set-point: what would be believed if it were measured,
    and no more power than is installed; of set-points by default what rooms have."""
    limits = {name: _limits(zone.channels[name], zone.network.channel_unit(name)) for name in zone.network.channels}
    if zone.setpoint is not None:
        usual = zone.setpoint.valid in (None, default_valid_range("degC"))
        limits.setdefault(SET_POINTS, SET_POINT_RANGE if usual else _limits(zone.setpoint, "degC"))
    return limits


def _limits(channel: ChannelConfig, unit: str) -> tuple[float, float]:
    lower, upper = channel.valid or default_valid_range(unit)
    power = channel.installed or channel.nominal
    return (lower, upper) if power is None else (max(lower, -power), min(upper, power))


def _neighbour(measured: _Measured, zone: ZoneConfig, channel: ChannelConfig) -> tuple[str, str] | None:
    """The zone and its output that are measured where `channel` is: the room next door."""
    there = measured.get((channel.source, channel.address), ())
    return next((found for found in there if found[0] != zone.id), None)


def _link(config: Config, channel: ChannelConfig, unit: str) -> WeatherLink:
    assert channel.forecast is not None
    given = channel.forecast.unit or unit
    table = config.weather[channel.forecast.source]
    return WeatherLink(channel.forecast.source, channel.forecast.series, given, conversion(given, unit), table.max_age)


def fingerprint(zone: ZoneConfig) -> str:
    """What a stored state of `zone` belongs to."""
    structure = registry.structure(zone.estimator, zone.options)
    return snapshot.fingerprint(zone.network, zone.period, zone.estimator, structure)


def neighbourhood(config: Config, zone: ZoneConfig, checkpoints: Checkpoints) -> Callable[[], Checkpoint | None]:
    """Makes the checkpoint with which `zone`, a new one, begins: what the other zones of `config` teach it. None where
    they teach nothing, and where the site does not want that. It blocks, and may raise ServiceError."""

    def ask() -> Checkpoint | None:
        if not config.site.neighbours:
            return None
        others = (_worker(other, checkpoints) for other in config.zones if other.id != zone.id)
        worker = make_worker(zone)
        found = taught(worker, islice((worker for worker in others if worker is not None), _MOST_ASKED))
        return None if found is None else snapshot.beginning(worker, fingerprint(zone), zone.estimator, found)

    return ask


def taught(worker: ZoneWorker, others: Iterable[ZoneWorker]) -> Experience | None:
    """What the workers of `others` teach that of a new zone; those whose telemetry cannot be believed teach nothing."""
    learned = [
        Learned(other.estimator, other.standing.state, other.standing.update.time + other.period)
        for other in others
        if other.standing is not None and not other.carried.suspicions
    ]
    return experience(worker.estimator, learned) or None


def _worker(zone: ZoneConfig, checkpoints: Checkpoints) -> ZoneWorker | None:
    """The worker of `zone` as its newest checkpoint has it; None without one that belongs to it."""
    newest = checkpoints.newest(zone.id)
    checkpoint = None if newest is None else newest.checkpoint
    if checkpoint is None or checkpoint.is_beginning or checkpoint.fingerprint != fingerprint(zone):
        return None
    worker = make_worker(zone)
    snapshot.restore(worker, checkpoint)
    return worker
