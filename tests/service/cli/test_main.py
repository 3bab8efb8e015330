"""The command line: arguments, exit codes, and what an operator reads when something is wrong."""

import os
import re
import subprocess
import sys
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from support.config_samples import learned, sound, write
from support.harness import ROOT

from adapters.errors import SourceUnavailable
from replay.errors import ReplayError
from service.cli.main import main
from service.config.load import load
from service.errors import JournalError

Capture = pytest.CaptureFixture[str]
Call = tuple[tuple[Any, ...], dict[str, Any]]


@pytest.fixture
def config(tmp_path: Path) -> Path:
    return write(tmp_path, sound(tmp_path))


def stand_in(monkeypatch: pytest.MonkeyPatch, module: str, name: str, answer: Callable[..., Any]) -> list[Call]:
    """Replace a function that a command imports; returns the list its calls are noted in."""
    calls: list[Call] = []

    def function(*args: Any, **kwargs: Any) -> Any:
        calls.append((args, kwargs))
        return answer(*args, **kwargs)

    monkeypatch.setitem(sys.modules, module, types.SimpleNamespace(**{name: function}))
    return calls


def daemon(monkeypatch: pytest.MonkeyPatch, answer: Callable[..., Any] = lambda *_, **__: 0) -> list[Call]:
    return stand_in(monkeypatch, "service.daemon.run", "run_daemon", answer)


def complaint(capsys: Capture) -> str:
    """The only line on stderr."""
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("thermogate: ")
    return line.removeprefix("thermogate: ")


def test_the_version_and_what_is_no_command(capsys: Capture) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("thermogate ")
    for argv, gist in (([], "COMMAND; see thermogate --help"), (["rnu"], "invalid choice: 'rnu'")):
        assert main(argv) == 2
        assert gist in complaint(capsys)


def test_check_warns_of_state_with_which_run_does_not_start(config: Path, capsys: Capture) -> None:
    for place in (0, 1):
        learned(load(config), place)
    assert main(["check", str(config)]) == 0
    assert "stored state" not in capsys.readouterr().out
    assert main(["check", str(config), "--set", "zones.living.network=titeth"]) == 0
    (warning,) = [line for line in capsys.readouterr().out.splitlines() if "stored state" in line]
    assert warning.startswith("warning: zone 'living': the stored state in ")
    assert "`thermogate run CONFIG --reset living`" in warning


def test_run_starts_the_daemon_and_passes_on_what_to_reset_and_the_exit_code(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = daemon(monkeypatch, lambda *_, **__: 1)
    for reset in ([], ["--reset", "bedroom", "--reset", "living"], ["--reset", "bedroom", "living"]):
        assert main(["run", str(config), *reset]) == 1
    assert [options["reset"] for _, options in calls] == [[], ["bedroom", "living"], ["bedroom", "living"]]
    (started,), options = calls[0]
    assert [zone.id for zone in started.zones] == ["living", "bedroom"]
    assert options["reread"]().zones == started.zones


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (JournalError("site.state_dir: cannot be written; choose another folder"), 1, "site.state_dir: cannot be"),
        (SourceUnavailable("sources.log: gone; bring it back"), 1, "sources.log: gone; bring it back"),
        (ReplayError("--out: not a folder; name another"), 1, "--out: not a folder; name another"),
        (PermissionError(13, "Permission denied", "/srv/state"), 1, "/srv/state: Permission denied; check the path"),
        (RuntimeError("two\nlines"), 1, "unexpected RuntimeError: two lines; "),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
    ids=repr,
)
def test_a_failure_is_one_sentence(
    error: BaseException, code: int, said: str, config: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    daemon(monkeypatch, Mock(side_effect=error))
    assert main(["run", str(config)]) == code
    found = complaint(capsys)
    assert found.startswith(said)
    assert ("--debug" in found) is isinstance(error, RuntimeError)
    if "--debug" in found:
        assert main(["run", "--debug", str(config)]) == 1
        assert "Traceback (most recent call last)" in capsys.readouterr().err


def test_replay_passes_everything_on(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = stand_in(monkeypatch, "replay.recorded.runner", "replay_recording", lambda *_, **__: 0)
    stand_in(monkeypatch, "replay.reports.publish", "publish_report", lambda *_, **__: 0)
    monkeypatch.setattr(sys.modules["replay.reports.publish"], "FILE", "report.html", raising=False)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    given = ["--zone", "living", "--seed", "9", "--start", "2025-05-03T00:00:00Z", "--end", "2025-05-03T04:00:00+02:00"]
    assert main(["replay", str(config), "--out", "out", *given]) == 0
    (((loaded, out), options),) = calls
    assert (loaded.site.id, out) == ("house", Path("out"))
    assert options == {"zone": "living", "seed": 9, "start": 1746230400.0, "end": 1746237600.0, "progress": True}


def test_demo_runs_the_daemon_on_its_building(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    plants = []

    @contextmanager
    def building(plant: Any) -> Iterator[tuple[Path, str]]:
        plants.extend(plant.args)
        plants[-1].directory.mkdir(exist_ok=True)
        yield write(plants[-1].directory, sound(plants[-1].directory)), "http://127.0.0.1:5021"

    stand_in(monkeypatch, "replay.bms.background", "in_background", building)
    runs, home = daemon(monkeypatch), tmp_path / "my home"
    given = ["--directory", str(home), "--port", "0", "--pace", "60", "--duration", "2.5"]
    assert main(["demo"]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"http://127.0.0.1:\d+/docs", shown)
    assert sum(line.startswith("  curl ") for line in shown.splitlines()) == 5
    assert main(["demo", *given[:2]]) == 0
    assert f"thermogate report '{home}/" in capsys.readouterr().out, "as a shell takes it"
    assert main(["demo", *given, "--set", "zones.living.period=10min", "--set", "http.port=0"]) == 0
    assert "log below" in capsys.readouterr().out
    usual, _, chosen = plants
    assert (usual.pace, usual.directory.exists()) == (600.0, False), "the temporary folder is gone"
    assert (chosen.directory, chosen.pace, chosen.overrides[0]) == (home, 60.0, "http.port=0")
    assert (usual.knows, chosen.knows) == (True, False), "rooms of another period have learned nothing yet"
    assert [options for _, options in runs] == [{"duration": None}, {"duration": None}, {"duration": 2.5}]
    assert runs[2][0][0].zones[0].period == 600
    assert home.exists()


@pytest.mark.parametrize("levels", [300, 20_000])
def test_what_is_nested_too_deeply_is_the_operators_mistake(levels: int, tmp_path: Path, capsys: Capture) -> None:
    deep = "[" * levels + "]" * levels
    for text in (f"a = {deep}\n", f"[{'.'.join('a' * levels)}]\n"):
        (tmp_path / "deep.toml").write_text(text, encoding="utf-8")
        assert main(["check", str(tmp_path / "deep.toml")]) == 2
        said = capsys.readouterr().err
        assert "nested too deeply" in said or levels == 300
        assert "fault of Thermogate" not in said
    assert main(["check", str(write(tmp_path, sound(tmp_path))), "--set", f"http.port={deep}"]) == 2
    assert "fault of Thermogate" not in capsys.readouterr().err


def test_output_that_nobody_reads_to_the_end_is_no_failure_to_talk_about() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "service", "networks"]
    ended = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, cwd=ROOT, check=False)
    os.close(writing)
    assert (ended.returncode, ended.stderr) == (1, b"")


_LEAVES_THREADS = """
import atexit, sys, threading, time, zenoh
from service.cli.main import main
config = zenoh.Config()
config.insert_json5("listen/endpoints", "[]")
config.insert_json5("scouting/multicast/enabled", "false")
publisher = zenoh.open(config).declare_publisher("a/b")

def put():
    while True:
        publisher.put(b"x")

for _ in range(4):
    threading.Thread(target=put, daemon=True).start()
atexit.register(print, "at the end")
sys.argv = ["thermogate", *sys.argv[1:]]
sys.exit(main())
"""


@pytest.mark.parametrize(("word", "code"), [("--version", 0), ("rnu", 2)])
def test_a_thread_that_a_library_has_left_does_not_abort_the_process(word: str, code: int) -> None:
    ended = subprocess.run([sys.executable, "-c", _LEAVES_THREADS, word], capture_output=True, text=True, timeout=60)
    assert ended.returncode == code, ended.stderr
    assert "at the end" in ended.stdout
