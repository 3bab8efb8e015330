"""`thermogate backup` of a running daemon, `restore` into another folder, `inspect` of what is there."""

from __future__ import annotations

import re
from pathlib import Path

from support.harness import EXAMPLES, Daemon, overrides, thermogate

CONFIG = EXAMPLES / "building-67.toml"
ZONE = "building-67"


def settings(state: Path, pace: object) -> dict[str, object]:
    return {
        "site.state_dir": str(state),
        "site.checkpoint_every": 0.3,
        "zones.0.estimator_options.particles": 200,
        "sources.simulation.pace": pace,
    }


def test_a_backup_of_a_running_daemon_goes_on_bit_for_bit(tmp_path: Path) -> None:
    live, restored = tmp_path / "live", tmp_path / "restored"
    kept = tmp_path / "kept.tar"
    with Daemon(CONFIG, tmp_path / "first.log", settings(live, 36000)) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 80)
        done = thermogate("backup", CONFIG, kept, *overrides(settings(live, 1)))
        assert (done.returncode, done.stderr) == (0, "")
        assert re.fullmatch(rf"{kept}: site semi-synthetic, \d+\.\d MB, zones with a checkpoint: 1\n", done.stdout)
        refused = thermogate("restore", CONFIG, kept, "--replace", *overrides(settings(live, 1)))
        assert refused.returncode == 1
        assert "another thermogate already runs on site.state_dir" in refused.stderr
        daemon.wait_until_ended()
        expected = daemon.history(ZONE)
        forecast = daemon.get(f"/zones/{ZONE}/forecast")
        assert "Traceback" not in daemon.log()
    done = thermogate("restore", CONFIG, kept, *overrides(settings(restored, 1)))
    assert (done.returncode, done.stderr) == (0, "")
    assert "as it was at" in done.stdout
    reported = thermogate("report", restored, "--out", tmp_path / "report")
    assert (reported.returncode, (tmp_path / "report" / "report.html").exists()) == (0, True), reported.stderr
    with Daemon(CONFIG, tmp_path / "second.log", settings(restored, "max")) as daemon:
        assert "intervals replayed from the journal" in (daemon.url() and daemon.log())
        daemon.wait_until_ended()
        assert daemon.history(ZONE) == expected
        assert daemon.get(f"/zones/{ZONE}/forecast") == forecast
        assert "goes on after" in daemon.log()


def test_a_checkpoint_is_shown_and_a_damaged_one_is_one_sentence(tmp_path: Path) -> None:
    with Daemon(CONFIG, tmp_path / "log", settings(tmp_path / "state", 36000)) as daemon:
        daemon.wait(lambda zones: zones[ZONE]["samples"] >= 20)
        assert daemon.terminate() == 0
    newest = max((tmp_path / "state" / "checkpoints" / ZONE).glob("*.npz"))
    shown = thermogate("inspect", newest)
    assert (shown.returncode, shown.stderr) == (0, "")
    for line in (
        rf"zone +{ZONE}",
        r"after the sample at +20\d\d-\d\d-\d\dT\d\d:\d\d:00Z",
        r"network +building-67",
        r"estimator +rbpf",
        r"period +600 s",
        r"digest +right",
        r"C_i +\d\S* +J/K",
        r"estimator\.\w+ +float64 +\(\d+, 200\) +\d+ B",
    ):
        assert re.search(rf"^{line}", shown.stdout, re.MULTILINE), (line, shown.stdout)
    damaged = tmp_path / "damaged.npz"
    content = newest.read_bytes()
    for part in (content[: len(content) // 2], content[:500] + b"\x00" + content[501:], b""):
        damaged.write_bytes(part)
        told = thermogate("inspect", damaged)
        assert (told.returncode, told.stdout) == (1, "")
        assert re.fullmatch(rf"thermogate: {damaged} is damaged \(.*\); the daemon sets such a file .*\n", told.stderr)
    assert thermogate("inspect", tmp_path / "nothing.npz").returncode == 1
