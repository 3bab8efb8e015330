"""The connection to the database of a fleet, with the password from its file."""

from __future__ import annotations

from adapters.errors import SourceConfigError
from adapters.fields.logins import password
from service.config.fleet import FleetConfig
from service.errors import ServiceError


def connection_of(fleet: FleetConfig) -> str:
    """What psycopg connects with. Raises ServiceError where the file of the password cannot be read."""
    from psycopg.conninfo import make_conninfo

    if fleet.password_file is None:
        return fleet.database
    try:
        return make_conninfo(fleet.database, password=password(fleet.password_file, None))
    except SourceConfigError as error:
        raise ServiceError(f"fleet.{error}; give it to the account that the fleet runs as") from error
