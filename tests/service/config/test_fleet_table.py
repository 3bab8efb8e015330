"""[fleet] of the configuration: what is wrong with it is one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.campus import write_site

from service.cli.main import main
from service.config.load import load
from service.errors import ConfigError
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


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("zenoh.enabled=true", "zenoh.listen: every shard would listen there"),
        ("mqtt.host=broker.example", "mqtt.host: a fleet publishes on Zenoh alone"),
        ("http.socket=http.sock", "http.socket: a fleet serves every machine's clients at an address"),
    ],
)
def test_what_a_fleet_cannot_do_is_refused(tmp_path: Path, setting: str, sentence: str) -> None:
    path = site(tmp_path)
    path.write_text(path.read_text(encoding="utf-8").replace("port = 0\n", ""), encoding="utf-8")
    config = load(path, [setting])
    with pytest.raises(ConfigError) as caught:
        fleet_of(config)
    assert [sentence in problem for problem in caught.value.problems] == [True]


def test_a_site_without_the_table_is_no_fleet(tmp_path: Path) -> None:
    path = site(tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text[: text.index("[fleet]")] + text[text.index("[sources.log]") :], encoding="utf-8")
    with pytest.raises(ConfigError, match="fleet: is missing"):
        fleet_of(load(path))


def test_a_backup_of_what_is_not_in_a_folder_names_the_tools_for_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["backup", str(site(tmp_path)), str(tmp_path / "out")]) == 1
    assert "a fleet keeps it in the database that fleet.database names" in capsys.readouterr().err
