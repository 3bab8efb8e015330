"""What a configuration needs to be run as a fleet, and what a fleet needs of it."""

from collections.abc import Iterator
from importlib.util import find_spec

from adapters.errors import SourceConfigError
from adapters.fields.logins import password
from service.config.fleet import FleetConfig
from service.config.site import Config
from service.errors import ConfigError, ServiceError


def require_extra() -> None:
    """ServiceError where what the extra `fleet` brings is not installed."""
    missing = [name for name in ("ray", "psycopg") if find_spec(name) is None]
    if missing:
        raise ServiceError(
            f"a fleet needs {' and '.join(missing)}, which the daemon on one machine does not; install it with "
            "pip install 'thermogate[fleet]'"
        )


def fleet_of(config: Config) -> FleetConfig:
    """The table [fleet] of a configuration that can be run as a fleet. Raises ConfigError."""
    if problems := list(_problems(config)):
        raise ConfigError(problems)
    assert config.fleet is not None
    return config.fleet


def connection_of(fleet: FleetConfig) -> str:
    """What psycopg connects with, the password from its file. Raises ServiceError where that cannot be read."""
    from psycopg.conninfo import make_conninfo

    if fleet.password_file is None:
        return fleet.database
    try:
        return make_conninfo(fleet.database, password=password(fleet.password_file, None))
    except SourceConfigError as error:
        raise ServiceError(f"fleet.{error}; give it to the account that the fleet runs as") from error


def _problems(config: Config) -> Iterator[str]:
    if config.fleet is None:
        yield 'fleet: is missing; add [fleet] and a line such as database = "postgresql://thermogate@db.example/thermogate"'
    zenoh = config.table("zenoh")
    if zenoh.enabled and zenoh.listen:
        yield (
            "zenoh.listen: every shard would listen there; write listen = [] and name the site's router in connect, or "
            "switch publishing off with enabled = false"
        )
    if config.table("mqtt").host is not None:
        yield (
            "mqtt.host: a fleet publishes on Zenoh alone; remove the table, and bridge Zenoh to the broker where one "
            "is needed"
        )
    if config.http.socket is not None:
        yield "http.socket: a fleet serves every machine's clients at an address; give host and port instead"
