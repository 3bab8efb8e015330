"""The installation as a service: upgraded, taken back and removed under another root, where nothing is started."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from support.harness import EXAMPLES, ROOT

SCRIPT = ROOT / "deploy" / "systemd" / "install"


def install(root: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run the script without a network: pip and the libraries are those of this environment."""
    python = root.parent / "python3"
    python.write_text(
        f'#!/bin/sh\n[ "$1 $2" != "-m venv" ] || set -- -m venv --without-pip "$3"\nexec {sys.executable} "$@"'
    )
    python.chmod(0o755)
    offline = {"PIP_NO_INDEX": "1", "PIP_NO_DEPS": "1", "PIP_NO_COMPILE": "1"}
    offline |= {"PYTHONPATH": sysconfig.get_path("purelib"), "DESTDIR": str(root), "PYTHON": str(python)}
    command = [SCRIPT, *options]
    return subprocess.run(command, env=os.environ | offline, capture_output=True, text=True, timeout=600, check=False)


def test_an_installation_is_upgraded_taken_back_and_removed(built: tuple[Path, Path], tmp_path: Path) -> None:
    root, wheel = tmp_path / "root", built[1]
    programs, state = root / "opt", root / "var/lib/thermogate/journal.sqlite3"
    configuration, unit = root / "etc/thermogate/thermogate.toml", root / "etc/systemd/system/thermogate.service"
    done = install(root, "--wheel", str(wheel))
    assert done.returncode == 0, done.stderr
    assert "write /etc/thermogate/thermogate.toml, then: systemctl enable --now thermogate" in done.stdout
    assert unit.read_text() == (ROOT / "deploy/systemd/thermogate.service").read_text()
    first = (programs / "thermogate").readlink()
    # The program that the unit names.
    assert f"ExecStart={Path('/') / (programs / 'thermogate/bin/thermogate').relative_to(root)} run" in unit.read_text()

    state.parent.mkdir(parents=True)
    state.write_text("what was learned")
    shutil.copytree(EXAMPLES / "data", configuration.parent / "data")
    configuration.write_text((EXAMPLES / "generic-csv.toml").read_text() + "\n[nonsense]\n")
    done = install(root, "--wheel", str(wheel))
    assert done.returncode == 1
    assert "nonsense" in done.stderr
    assert "the new version does not take" in done.stderr
    assert sorted(path.name for path in programs.iterdir()) == sorted(["thermogate", str(first)])

    configuration.write_text((EXAMPLES / "generic-csv.toml").read_text())
    done = install(root, "--wheel", str(wheel))
    assert done.returncode == 0, done.stderr
    assert (programs / "thermogate").readlink() != first
    assert install(root, "--back").returncode == 0
    assert (programs / "thermogate").readlink() == first
    version = subprocess.run([programs / "thermogate/bin/python", "--version"], capture_output=True, check=True)
    assert version.stdout.startswith(b"Python 3.")

    done = install(root, "--remove")
    assert (done.returncode, list(programs.iterdir()), unit.exists()) == (0, [], False), done.stderr
    assert (state.read_text(), configuration.exists()) == ("what was learned", True)


def test_a_mistaken_call_is_refused_in_one_sentence(tmp_path: Path) -> None:
    for option, sentence in (("--purge", "'--purge' is no option"), ("--back", "there is no program before this one")):
        done = install(tmp_path / "root", option)
        assert (done.returncode, done.stderr.count("\n")) == (1, 1)
        assert sentence in done.stderr
    (tmp_path / "root/opt/thermogate").mkdir(parents=True)
    done = install(tmp_path / "root")
    assert (done.returncode, "was installed by hand" in done.stderr) == (1, True)
