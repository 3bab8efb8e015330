"""[fleet]: how the zones of a site are spread over the machines of a Ray cluster, and where their state is kept."""

from typing import Annotated
from urllib.parse import parse_qs, urlsplit

from pydantic import AfterValidator, BeforeValidator, Field

from adapters.fields.durations import format_duration
from adapters.fields.tables import Table
from adapters.fields.values import FilePath, Positive, PositiveDuration, text, whole

SHORTEST_LEASE = 2.0
LONGEST_LEASE = 60.0
MOST_SHARDS = 4096
_SECRETS = frozenset({"password", "sslpassword"})
"""Parameters of an address that hold a secret."""


def database_address(value: object) -> str:
    """The address of a PostgreSQL database, without a password; it may name several servers, each with its port."""
    try:
        parts = urlsplit(text(value))
        given = parts.password is not None or not _SECRETS.isdisjoint(parse_qs(parts.query, keep_blank_values=True))
        # Of several servers Python takes all ports for one.
        port = None if "," in parts.netloc else parts.port
    except ValueError:
        parts, given, port = None, False, None
    if given:
        # What is there must not end up in a log.
        raise ValueError("holds a password; put that into a file of its own, and name the file in password_file")
    if parts is None or parts.scheme not in ("postgresql", "postgres") or len(parts.path) < 2 or port == 0:
        raise ValueError(
            "is not the address of a PostgreSQL database; write one such as "
            '"postgresql://thermogate@db.example:5432/thermogate"'
        )
    return str(value)


def lease_length(seconds: float) -> float:
    """How long a shard may go on without the database having heard of it, s."""
    if not SHORTEST_LEASE <= seconds <= LONGEST_LEASE:
        shortest, longest = format_duration(SHORTEST_LEASE), format_duration(LONGEST_LEASE)
        raise ValueError(f"must be from {shortest} to {longest}, not {format_duration(seconds)}")
    return seconds


class FleetConfig(Table):
    """[fleet]: read by `thermogate fleet`; the daemon on one machine passes it over."""

    database: Annotated[str, BeforeValidator(database_address)] = Field(
        description='the PostgreSQL database, such as "postgresql://thermogate@db.example/thermogate"'
    )
    password_file: FilePath | None = Field(
        default=None, description="file with the password of the database and nothing else"
    )
    shards: Annotated[int, BeforeValidator(whole(1, MOST_SHARDS))] = Field(
        default=2, description="processes that the zones are spread over"
    )
    shard_cpus: Positive = Field(default=1.0, description="processors that Ray reserves for a shard")
    lease: Annotated[PositiveDuration, AfterValidator(lease_length)] = Field(
        default=5.0, description="a shard unheard of for so long loses its zones"
    )
