"""EnergyPlus from the outside: behind Modbus as a process, read by the daemon, and what is said without it."""

from __future__ import annotations

import json
import logging
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.bms_process import simulated
from support.energyplus import needs_energyplus
from support.harness import Daemon

from replay.energyplus import library
from service.cli.main import main

HOT = 28.0
"""A temperature [degC] that neither the thermostat nor the sun of a January bring about."""


@pytest.fixture
def log() -> Iterator[None]:
    """The log's handlers as they were, after a command that set its own."""
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    yield
    root.handlers[:] = handlers
    root.setLevel(level)


@needs_energyplus
def test_the_daemon_reads_a_building_of_energyplus_and_the_plants_side_heats_it(tmp_path: Path) -> None:
    config = tmp_path / "bms.toml"
    arguments = ("--plant", "energyplus", "--building", "timber", "--weather", "chicago", "--zenoh", "off")
    settings: dict[str, object] = {"zones.house.estimator_options.particles": 200}
    with (
        simulated(*arguments, "--pace", 1800, "--write-config", config) as bms,
        Daemon(config, tmp_path / "log", settings) as daemon,
    ):
        assert "SYNTHETIC building 'timber' of EnergyPlus, weather chicago" in bms.greeting
        daemon.wait(lambda zones: zones["house"]["samples"] >= 2)
        assert all(row["y"] < HOT for row in daemon.history("house"))
        request = urllib.request.Request(
            f"{bms.control}/rooms/house",
            json.dumps({"u_heat": 6000}).encode(),
            {"Content-Type": "application/json"},
            method="PUT",
        )
        urllib.request.urlopen(request, timeout=180).close()
        daemon.wait(lambda _: daemon.history("house")[-1]["y"] > HOT)
        status, forecast = daemon.get("/zones/house/forecast")
        assert status == 200, forecast


@pytest.mark.usefixtures("log")
@pytest.mark.parametrize(
    ("arguments", "code", "gist"),
    [
        (["--building", "house"], 2, "--building belongs to --plant energyplus; leave it out, or choose that plant"),
        (["--plant", "energyplus", "--zones", "3"], 2, "--zones belongs to --plant rooms"),
        (
            ["--plant", "energyplus", "--building", "castle"],
            1,
            "there is no building 'castle'; the buildings are house",
        ),
    ],
)
def test_mistakes_are_one_sentence(
    arguments: list[str], code: int, gist: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate-bms", "--port", "0", "--control-port", "0", "--zenoh", "off", *arguments]) == code
    said = capsys.readouterr().err
    assert gist in said
    assert len(said.splitlines()) == 1


@pytest.mark.usefixtures("log")
def test_without_the_extra_the_command_says_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(library.importlib.util, "find_spec", lambda name: None)
    assert main(["simulate-bms", "--plant", "energyplus", "--port", "0", "--control-port", "0"]) == 1
    said = capsys.readouterr().err
    assert "EnergyPlus is not installed; install the extra with pip install 'thermogate[energyplus]'" in said
    assert len(said.splitlines()) == 1
