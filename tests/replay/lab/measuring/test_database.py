"""The cost of a day in PostgreSQL, for a handful of zones: the form of the report, not its figures."""

import json

import pytest
from support.postgres import Server

from replay.lab.measuring.database import main


def test_a_day_of_some_zones_is_measured_and_nothing_is_left(
    postgres_server: Server, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [postgres_server.connection, "--zones", "3", "--period", "7200", "--checkpoints", "2"]
    assert main(arguments) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["rows_per_zone_and_day"] == 24
    assert all(value > 0 for value in figures.values())
    assert figures["checkpoint_log_bytes"] > 2_400_000
    assert postgres_server.run("SELECT to_regnamespace('thermogate_measured')") == [(None,)]


def test_a_site_that_is_there_is_left_alone(postgres_server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    postgres_server.run("CREATE SCHEMA thermogate_measured")
    try:
        assert main([postgres_server.connection]) == 1
    finally:
        postgres_server.run("DROP SCHEMA thermogate_measured")
    assert "thermogate_measured is there already" in capsys.readouterr().out
