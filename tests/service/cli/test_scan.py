"""`thermogate probe --scan`: what devices have, listed before there are any zones."""

from pathlib import Path

import pytest
from support.modbus_plant import plant, running

from adapters.reading import Probe
from service.cli.commands.probe import probe_table
from service.cli.main import main

LOG = '[sources.log]\nkind = "csv"\nfiles = ["a.csv"]\ntimestamp = { column = "t" }\n'


def modbus(port: int) -> str:
    return f'[sources.bms]\nkind = "modbus"\nhost = "127.0.0.1"\nport = {port}\nfirst_register = 1\n'


def written(folder: Path, text: str) -> str:
    path = folder / "plant.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_registers_are_listed_without_any_zone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with running(plant({1: [215, 54], 2: [7]})) as site:
        path = written(tmp_path, modbus(site.port) + LOG)
        assert main(["probe", path, "--scan", "--registers", "1-2", "--tables", "holding"]) == 0
        title, headings, first, second = capsys.readouterr().out.splitlines()
        assert title == f"source bms: tcp 127.0.0.1:{site.port}, polled every 10s"
        assert headings.split() == ["unit", "table", "register", "hex", "int16", "might", "be"]
        assert first.split()[:5] == ["1", "holding", "1", "0x00d7", "215"]
        assert second.split()[:5] == ["1", "holding", "2", "0x0036", "54"]
        assert main(["probe", path, "--scan", "--devices", "2", "--registers", "1", "--source", "bms"]) == 0
        assert "2     holding  1         0x0007  7" in capsys.readouterr().out
        assert site.codes <= {3, 4}


def test_what_a_source_calls_its_things_does_not_steer_the_terminal() -> None:
    probe = Probe("room/T", "home/T", "-", None, None, "nothing came", ("heard meanwhile: home/\x1b[2J",))
    assert probe_table([probe], {"room/T": "degC"}, 0.0)[-1] == "    heard meanwhile: home/\\x1b[2J"


def test_a_device_that_is_not_there_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with running(plant({1: [1]})) as site:
        gone = site.port
    assert main(["probe", written(tmp_path, modbus(gone)), "--scan"]) == 1
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith(f"thermogate: sources.bms: no connection to 127.0.0.1:{gone}; check")
