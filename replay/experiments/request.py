"""What the command line asks of an experiment."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from replay.errors import ReplayError
from service.config.kept import kept_configuration
from service.config.load import load
from service.config.site import Config, ZoneConfig


@dataclass(frozen=True)
class Request:
    """One call of `thermogate experiment`; what is None or empty was not given."""

    data: tuple[Path, ...] = ()
    seeds: tuple[int, ...] = ()
    days: int | None = None
    particles: int | None = None
    config: Path | None = None
    state: Path | None = None
    """The state folder of a daemon, whose samples take the place of a recording."""
    zone: str | None = None
    overrides: tuple[str, ...] = ()
    building: tuple[str, ...] = ()
    """Names of buildings of EnergyPlus."""
    case: tuple[str, ...] = ()
    """Names of cases of the experiment."""
    contender: tuple[str, ...] = ()
    recording: tuple[str, ...] = ()
    """Names of recordings."""

    def seeds_or(self, count: int) -> tuple[int, ...]:
        """The seeds asked for, or 1 to `count`."""
        return self.seeds or tuple(range(1, count + 1))

    def accept(self, *names: str) -> None:
        """ReplayError if anything was given that is not among `names`, the fields that the experiment heeds."""
        for field in fields(self):
            if getattr(self, field.name) != field.default and field.name not in names:
                option = "--set" if field.name == "overrides" else f"--{field.name.replace('_', '-')}"
                raise ReplayError(f"{option} means nothing to this experiment; leave it out")
        if self.zone is not None and self.config is None and self.state is None:
            raise ReplayError(f"--zone {self.zone} chooses among the zones of a configuration; name that with --config")

    @property
    def configuration(self) -> Path | None:
        """The configuration asked for, or that of the daemon of --state; ServiceError where it keeps none."""
        return kept_configuration(self.state) if self.config is None and self.state is not None else self.config

    @property
    def file(self) -> Path | None:
        """The one data file, or None; ReplayError where there are several."""
        if len(self.data) > 1:
            raise ReplayError(f"--data was given {len(self.data)} times; this experiment takes one file")
        return self.data[0] if self.data else None


def names_of(files: Sequence[Path]) -> list[str]:
    """What a report calls each of `files`: its name without an ending. ReplayError where two have the same."""
    names = [path.stem for path in files]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ReplayError(f"--data has several files called '{twice[0]}', as the report would call them; rename one")
    return names


def chosen(request: Request) -> tuple[Config, ZoneConfig]:
    """The configuration of `request`, and its zone that --zone names, or its only one; ReplayError, ConfigError."""
    path = request.configuration
    if path is None:
        raise ReplayError("there is no configuration; name one with --config")
    config = load(path, request.overrides)
    zones = {zone.id: zone for zone in config.zones}
    if request.zone is None and len(zones) == 1:
        return config, config.zones[0]
    if request.zone not in zones:
        wrong = f"there is no zone '{request.zone}'" if request.zone else "it has several zones; choose one with --zone"
        raise ReplayError(f"{path}: {wrong}; the zones are {', '.join(zones)}")
    return config, zones[request.zone]
