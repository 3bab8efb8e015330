"""[fleet] of the configuration: what is wrong with it is one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.campus import write_site

from service.config.load import load
from service.fleet.checks import fleet_of

DATABASE = "postgresql://thermogate@db.example/thermogate"


def site(folder: Path) -> Path:
    return write_site(folder, DATABASE, site="campus", count=1, shards=3, pace=60.0, lease=5.0)


def test_the_table_says_where_the_state_is(tmp_path: Path) -> None:
    config = load(site(tmp_path), ["fleet.password_file=secret"])
    assert fleet_of(config).database == DATABASE
    assert fleet_of(config).password_file == tmp_path / "secret"
    assert (fleet_of(config).shards, fleet_of(config).lease) == (3, 5.0)


@pytest.mark.parametrize("servers", ["a,b", "a:5432,b:5433"])
def test_the_database_may_be_on_several_servers(tmp_path: Path, servers: str) -> None:
    database = f"postgresql://thermogate@{servers}/thermogate?target_session_attrs=read-write"
    assert fleet_of(load(site(tmp_path), [f"fleet.database={database}"])).database == database
