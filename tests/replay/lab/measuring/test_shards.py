"""The fleets that are measured beside the daemon: what they run, and how the figures are compared."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.postgres import Server

from replay.lab.measuring.scenario import Scenario
from replay.lab.measuring.shards import _against, _write_site, main, table
from service.config.load import load
from service.fleet.checks import fleet_of

SCENARIO = Scenario(zones=3, particles=50, preset="building-67", every=1.0, rounds=4)
DAEMON = {
    "shards": 0,
    "samples_per_second": 100.0,
    "cpu_seconds_per_1000_samples": 10.0,
    "idle_processors": 0.01,
    "resident_bytes": 5e8,
}
FLEET = DAEMON | {"shards": 2, "samples_per_second": 80.0, "cpu_seconds_per_1000_samples": 11.0}


@pytest.mark.parametrize("shards", [0, 1, 4])
def test_the_daemon_and_the_fleets_run_the_same_zones(tmp_path: Path, shards: int) -> None:
    config = load(_write_site(SCENARIO, tmp_path, "measured", 8080, "postgresql://db.example/x", shards))
    assert len(config.zones) == 3
    assert config.http.port == 8080
    assert fleet_of(config).shards == max(1, shards)


def test_a_fleet_is_compared_with_the_daemon() -> None:
    assert _against(DAEMON, DAEMON) == {"slower_percent": 0.0, "more_cpu_percent": 0.0}
    found = _against(FLEET, DAEMON)
    assert found["slower_percent"] == pytest.approx(20.0)
    assert found["more_cpu_percent"] == pytest.approx(10.0)
    head, daemon, fleet = table([DAEMON | _against(DAEMON, DAEMON), FLEET | found]).splitlines()
    assert "samples/s" in head
    assert daemon.split()[:2] == ["daemon", "100.0"]
    assert "-20.0 %" in fleet
    assert "+10.0 %" in fleet


def test_a_site_that_is_there_is_left_alone(
    tmp_path: Path, postgres_server: Server, capsys: pytest.CaptureFixture[str]
) -> None:
    database = f"postgresql://postgres@/postgres?host={postgres_server.folder}"
    postgres_server.run('CREATE SCHEMA "thermogate_measured-1"')
    try:
        assert main([database, "--zones", "1", "--shards", "1", "--out", str(tmp_path)]) == 1
        assert postgres_server.run("SELECT to_regnamespace('\"thermogate_measured-1\"') IS NOT NULL") == [(True,)]
    finally:
        postgres_server.run('DROP SCHEMA "thermogate_measured-1"')
    assert "thermogate_measured-1 is there already" in capsys.readouterr().err
