"""`thermogate report` on the state folder of a daemon that runs."""

from support.harness import EXAMPLES, Daemon, thermogate

CONFIG = EXAMPLES / "building-67.toml"
ZONE = "building-67"


def test_the_report_of_a_running_daemon_says_what_the_daemon_says(tmp_path):
    state, out = tmp_path / "state", tmp_path / "out"
    settings = {
        "site.state_dir": str(state),
        f"zones.{ZONE}.estimator": "arx",
        f"zones.{ZONE}.estimator_options": {},
    }
    with Daemon(CONFIG, tmp_path / "log", settings) as daemon:
        daemon.wait_until_ended()
        history = daemon.history(ZONE)
        done = thermogate("report", state, "--out", out)
        assert daemon.process.poll() is None
    assert done.returncode == 0, done.stderr
    assert (out / "report.html").stat().st_size > 1e6
    (row,) = [line.split() for line in done.stdout.splitlines() if line.startswith(f"{ZONE}  one step")]
    assert 0 < int(row[3]) <= len(history)
    assert "bit for bit" in (out / "report.html").read_text()

    wrong = thermogate("report", state, "--zone", "attic")
    assert (wrong.returncode, wrong.stderr) == (
        2,
        f'thermogate: --zone: there is no zone "attic"; the zones are {ZONE}\n',
    )
    nothing = thermogate("report", tmp_path / "elsewhere")
    assert nothing.returncode == 1
    assert "there is no configuration.toml in" in nothing.stderr
