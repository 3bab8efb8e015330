"""The configuration as the daemon sees it: every table of the TOML file as a frozen model with its defaults.

`service.config.load` builds a `Config`; nothing else needs to. Descriptions complete the sentences
"is missing; give ..." and "must be ...".
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, BeforeValidator, Field, SerializeAsAny, ValidationInfo, model_validator

from adapters.zenoh_access import publishing
from adapters.zenoh_connection import Connection
from service.config_types import (
    Duration,
    Endpoint,
    FilePath,
    Flag,
    Identifier,
    JournalSize,
    Levels,
    Period,
    PositiveDuration,
    Text,
    context,
    whole,
)
from service.durations import DAY
from service.http_models import HttpConfig
from service.log_models import LogConfig
from service.modbus_models import ModbusConfig
from service.network_models import TABLE, NetworkConfig
from service.source_models import ChannelConfig, CsvConfig
from service.zenoh_models import ZenohSourceConfig
from service.zenoh_session_models import Mode, SessionConfig


class SiteConfig(BaseModel):
    """[site]: who this is, and where state is kept."""

    model_config = TABLE

    id: Identifier = Field(description='the name of the site, such as "htwg"')
    state_dir: FilePath = Field(default=Path("var/thermogate"), validate_default=True)
    checkpoint_every: PositiveDuration = 300.0
    keep_history: PositiveDuration = 400 * DAY
    max_journal: JournalSize = 2 * 10**9


class ZenohConfig(SessionConfig):
    """[zenoh]: the daemon's own session."""

    enabled: Flag = True
    mode: Mode = "peer"
    listen: tuple[Endpoint, ...] = Field(
        default=("tcp/127.0.0.1:7447",), description='a list of endpoints, such as ["tcp/127.0.0.1:7447"]'
    )
    await_subscriber: Duration = 0.0

    @model_validator(mode="after")
    def _client_has_a_router(self) -> Self:
        if self.enabled and self.mode == "client" and not self.connect:
            raise ValueError('mode "client" needs a router to connect to; list it in connect, or use mode "peer"')
        return self

    def connection(self, site: str) -> Connection:
        """The session in which everyone who can connect may read what `site` publishes, and do nothing else."""
        return self.session(publishing(f"thermogate/{site}/**"))


SourceConfig = Annotated[CsvConfig | ModbusConfig | ZenohSourceConfig, Field(discriminator="kind")]
"""The table of a source, told apart by its `kind`."""


def default_seed(site: str, zone: str) -> int:
    """The seed of a zone that gives none: the same on every machine and after every restart."""
    return zlib.crc32(f"{site}/{zone}".encode())


class ZoneConfig(BaseModel):
    """[[zones]]: one thermal zone with its own grid, network and estimator."""

    model_config = TABLE

    id: Identifier = Field(description='the name of the zone, such as "living"')
    period: Period = Field(description='the sampling period, such as "5min"')
    network: NetworkConfig = Field(description='a preset such as "titeth", or a [zones.network] table')
    estimator: Text = "rbpf"
    seed: Annotated[int, BeforeValidator(whole(0, 2**63 - 1))]
    levels: Levels = Field(default=(0.95,), min_length=1, description="a list of levels, such as [0.5, 0.95]")
    max_gap: Annotated[int, BeforeValidator(whole(0, 1_000_000))] = 12
    hold_inputs: Duration = 900.0
    lateness: Duration = 0.0
    estimator_options: dict[str, Any] = Field(default={}, description="a table, such as particles = 9000")
    channels: dict[str, SerializeAsAny[ChannelConfig]] = Field(
        description='a table with one line per channel, such as T_i = { source = "bms", column = "Ti", unit = "degC" }'
    )

    @model_validator(mode="before")
    @classmethod
    def _seeded(cls, table: Any, info: ValidationInfo) -> Any:
        if not isinstance(table, dict) or "seed" in table:
            return table
        return table | {"seed": default_seed(str(context(info)["site"]), str(table.get("id")))}


class Config(BaseModel):
    """The whole configuration, every default filled in and every path absolute."""

    model_config = TABLE

    site: SiteConfig
    log: LogConfig
    http: HttpConfig
    zenoh: ZenohConfig
    sources: dict[str, SourceConfig]
    zones: tuple[ZoneConfig, ...]

    @property
    def keys_file(self) -> Path:
        """Where the API keys are."""
        return self.http.keys_file or self.site.state_dir / "keys.json"
