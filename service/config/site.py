"""The configuration as the daemon sees it: every table of the TOML file as a frozen model with its defaults, built by
`service.config.load.load`. Descriptions complete the sentences "is missing; give ..." and "must be ..."."""

import zlib
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

from pydantic import BeforeValidator, Field, InstanceOf, SerializeAsAny, ValidationInfo, model_validator

from adapters.channel import Binding, ChannelConfig, RecordedConfig, SourceConfig
from adapters.fields.durations import DAY
from adapters.fields.tables import Table
from adapters.fields.values import (
    Country,
    Duration,
    FilePath,
    Flag,
    Identifier,
    JournalSize,
    Levels,
    Period,
    PositiveDuration,
    Text,
    TimeZone,
    choice,
    context,
    number_between,
    whole,
)
from adapters.fields.words import shown
from adapters.reading import Source
from adapters.weather.config import WeatherConfig
from adapters.weather.forecast import WeatherSource
from estimator.heat.sun import Location
from estimator.heat.terms import SUN_KINDS
from estimator.network.buildings import CONSTRUCTIONS, NOTHING_KNOWN, USES, Building
from estimator.network.network import Network
from service.config.fleet import FleetConfig
from service.config.http import HttpConfig
from service.config.log import LogConfig
from service.config.network_tables import NetworkConfig
from service.config.usual import usual
from service.publish.kinds import SINK_KINDS
from service.zone.alignment import SETPOINT, unit_of


def _sun(value: object) -> str | bool:
    if value is False:
        return False
    if value not in SUN_KINDS:
        kinds = ", ".join(f'"{kind}"' for kind in SUN_KINDS)
        raise ValueError(f"must be {kinds} or false, not {shown(value)}")
    return str(value)


Construction = Annotated[str, BeforeValidator(choice(*CONSTRUCTIONS))]
Built = Annotated[int, BeforeValidator(whole(1000, 2100))]
Use = Annotated[str, BeforeValidator(choice(*USES))]


class Whereabouts(NamedTuple):
    """What a zone takes from its site beside the telemetry; None for what is not known."""

    location: Location | None = None
    time_zone: str | None = None
    country: str | None = None
    building: Building = NOTHING_KNOWN


class SiteConfig(Table):
    """[site]: who this is, and where state is kept."""

    id: Identifier = Field(description='the name of the site, such as "htwg"')
    state_dir: FilePath = Field(
        default=Path("var/thermogate"), validate_default=True, description="folder of journal and checkpoints"
    )
    checkpoint_every: PositiveDuration = Field(default=300.0, description="time between two checkpoints of a zone")
    keep_history: PositiveDuration = Field(default=400 * DAY, description="how much history a zone keeps")
    max_journal: JournalSize = Field(
        default=2 * 10**9, description="largest size of the journal; the oldest rows go first"
    )
    neighbours: Flag = Field(default=False, description="whether a new zone begins with what others have learned")
    time_zone: TimeZone | None = Field(
        default=None, description="time zone of the page and of habits; none: the browser's"
    )
    latitude: Annotated[float | None, BeforeValidator(number_between(-90, 90, "degrees"))] = Field(
        default=None, description="degrees north; together with `longitude`"
    )
    longitude: Annotated[float | None, BeforeValidator(number_between(-180, 180, "degrees"))] = Field(
        default=None, description="degrees east"
    )
    country: Country | None = Field(
        default=None, description='country or part of one, such as `"DE-BW"`, whose public holidays count as weekends'
    )
    construction: Construction | None = Field(
        default=None, description="weight of the construction, for zones without the key"
    )
    built: Built | None = Field(default=None, description="year of construction or last insulation, likewise")
    use: Use | None = Field(default=None, description="use of the rooms, likewise")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.latitude is None) != (self.longitude is None):
            raise ValueError("has only one of latitude and longitude; give both, in degrees, or none")
        return self

    @property
    def whereabouts(self) -> Whereabouts:
        location = None
        if self.latitude is not None and self.longitude is not None:
            location = Location(self.latitude, self.longitude)
        building = Building(self.construction, self.built, self.use)
        return Whereabouts(location, self.time_zone, self.country, building)


DEFAULT_ESTIMATOR = "bank"
"""The estimator of a zone that names none."""
FORMER_ESTIMATOR = "rbpf"
"""What that was before: of a zone with state of it, and of one that gives options without an estimator."""


class ZoneTable(Table):
    """[[zones]] as it is written: one thermal zone with its own grid, network and estimator."""

    id: Identifier = Field(description='the name of the zone, such as "living"')
    period: Period = Field(description='the sampling period, such as "5min"')
    network: NetworkConfig = Field(description='a preset such as "auto", or a [zones.network] table')
    estimator: Text = Field(
        default=DEFAULT_ESTIMATOR,
        description='estimator: `"bank"`, `"rbpf"`, `"ekf"`, `"ukf"`, `"mkf"`, `"arx"`, `"daily"`, `"direct"`',
    )
    seed: Annotated[int, BeforeValidator(whole(0, 2**63 - 1))] = Field(
        description="seed of the random numbers; none: CRC-32 of `site/zone`"
    )
    habits: Flag | None = Field(
        default=None, description="whether it learns heat by the hour of the day; none: true for `auto`"
    )
    sun: Annotated[str | bool | None, BeforeValidator(_sun)] = Field(
        default=None, description="how the sun comes in; none: for `auto`, the best that its channels allow"
    )
    floor_area: Annotated[float | None, BeforeValidator(number_between(1, 100_000, "m2"))] = Field(
        default=None, description="floor area, which scales the priors"
    )
    construction: Construction | None = Field(default=None, description="weight of the construction; none: the site's")
    built: Built | None = Field(default=None, description="year of construction or last insulation; none: the site's")
    use: Use | None = Field(default=None, description="use; none: the site's")
    levels: Levels = Field(default=(0.95,), min_length=1, description="a list of levels, such as [0.5, 0.95]")
    max_gap: Annotated[int, BeforeValidator(whole(0, 1_000_000))] = Field(
        default=12, description="steps without a measured temperature that prediction bridges"
    )
    hold_inputs: Duration = Field(default=900.0, description="how long a missing input keeps its last value")
    lateness: Duration = Field(default=0.0, description="how long an interval stays open for late readings")
    estimator_options: dict[str, Any] = Field(default={}, description="a table, such as particles = 9000")
    channels: dict[str, SerializeAsAny[ChannelConfig]] = Field(
        description='a table with one line per channel, such as T_i = { source = "bms", column = "Ti", unit = "degC" }'
    )
    setpoint: SerializeAsAny[ChannelConfig] | None = Field(
        default=None, description='a table as that of a channel, such as { source = "bms", ..., unit = "degC" }'
    )

    @property
    def building(self) -> Building:
        """What its own table says of the building."""
        return Building(self.construction, self.built, self.use)

    @model_validator(mode="before")
    @classmethod
    def _seeded(cls, table: Any, info: ValidationInfo) -> Any:
        if not isinstance(table, dict) or "seed" in table:
            return table
        # The same on every machine and after every restart.
        return table | {"seed": zlib.crc32(f"{context(info)['site']}/{table.get('id')}".encode())}

    @model_validator(mode="before")
    @classmethod
    def _with_the_estimator_of_its_options(cls, table: Any) -> Any:
        if not isinstance(table, dict) or "estimator" in table or not table.get("estimator_options"):
            return table
        return table | {"estimator": FORMER_ESTIMATOR}


class ZoneConfig(ZoneTable):
    """A zone as it was checked: with its network, its estimator's options, and the defaults of its channels."""

    network: InstanceOf[Network]  # type: ignore[assignment]  # what the table describes takes the table's place
    options: Any
    """What `estimator_options` amount to: the resolved options of the estimator."""
    proposes_bounds: bool = False
    """Whether the zone proposes narrower bounds after its first week."""
    whereabouts: Whereabouts = Whereabouts()
    """Of the site."""

    @property
    def delivered(self) -> dict[str, ChannelConfig]:
        """Everything that sources deliver to the zone: its channels, and its set-point where there is one."""
        return self.channels if self.setpoint is None else {**self.channels, SETPOINT: self.setpoint}

    @property
    def sources(self) -> frozenset[str]:
        """The sources that deliver readings; a schedule has its values without any."""
        return frozenset(table.source for table in self.delivered.values() if not table.known_values)

    @property
    def max_ages(self) -> dict[str, float]:
        """How long inputs that have a time of their own may be held, s, by channel."""
        return {name: channel.max_age for name, channel in self.channels.items() if channel.max_age is not None}


TABLES = ("site", "log", "http", *SINK_KINDS, "fleet", "sources", "weather", "zones")
"""The tables of a configuration file, in the order in which they are shown."""


class Config(Table):
    """The whole configuration, every default filled in and every path absolute."""

    site: SiteConfig
    log: LogConfig
    http: HttpConfig
    sinks: dict[str, Any]
    """Tables of the kinds in `SINK_KINDS`, by name: [zenoh], ..."""
    sources: dict[str, SerializeAsAny[SourceConfig]]
    zones: tuple[ZoneConfig, ...]
    warnings: tuple[str, ...] = ()
    """What is no mistake, but probably not meant: one sentence each."""
    weather: dict[str, SerializeAsAny[WeatherConfig]] = Field(default={})
    fleet: FleetConfig | None = None
    """None where the file has no such table."""

    def table(self, name: str) -> Any:
        """The table [`name`] of the file, one of TABLES, as it was read."""
        return self.sinks[name] if name in self.sinks else getattr(self, name)

    @property
    def keys_file(self) -> Path:
        return self.http.keys_file or self.site.state_dir / "keys.json"

    def zones_of(self, source: str) -> tuple[ZoneConfig, ...]:
        """The zones that `source` feeds."""
        return tuple(zone for zone in self.zones if any(table.source == source for table in zone.delivered.values()))

    def bindings(self, source: str) -> list[Binding]:
        """Every channel that `source` delivers to."""
        return [
            Binding(f"{zone.id}/{channel}", table, unit_of(zone.network, channel), usual(zone.network, channel, table))
            for zone in self.zones
            for channel, table in zone.delivered.items()
            if table.source == source
        ]

    def build_source(self, name: str) -> Source:
        """The source of the table [sources.`name`], delivering to every channel of every zone that names it."""
        return self.sources[name].build(name, self.bindings(name))

    def rebind_source(self, name: str, source: Any) -> None:
        """Let a live `source`, built from the same table, deliver to the channels of this configuration."""
        source.rebind(self.bindings(name))

    def weather_series(self, name: str) -> tuple[str, ...]:
        """The series that channels want of the table [weather.`name`]."""
        told = [
            channel.forecast.series
            for zone in self.zones
            for channel in zone.channels.values()
            if channel.forecast is not None and channel.forecast.source == name
        ]
        return tuple(dict.fromkeys(told))

    def build_weather(self, name: str) -> WeatherSource:
        """The source of the table [weather.`name`], with every series that a channel wants of it."""
        return self.weather[name].build(name, self.weather_series(name))

    def is_live(self, source: str) -> bool:
        """Whether `source` tells what is now."""
        return self.sources[source].live

    def goes_live(self, zone: ZoneConfig) -> bool:
        """Whether the sources of `zone` are live; they are all live or all recorded."""
        return any(map(self.is_live, zone.sources))

    def pace_of(self, zone: ZoneConfig) -> float:
        """How many times faster than real time the telemetry of `zone` comes: 1 if it is live."""
        tables = [self.sources[channel.source] for channel in zone.delivered.values()]
        return min((table.pace for table in tables if isinstance(table, RecordedConfig)), default=1.0)
