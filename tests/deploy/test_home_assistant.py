"""The integration for Home Assistant, inside the real one: its own tests run there, against a daemon of ours."""

import csv
import json
import lzma
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tomli_w
import yaml
from support import sites
from support.harness import ROOT, THERMOGATE, Daemon
from support.home_assistant import HOME, clean
from support.thermostat_house import recorded

from replay.localtime import DAY
from replay.recorded.learning import learn
from service.config.load import load, load_history
from service.errors import ConfigError
from service.recordings.history import survey
from service.web.keys import Scope, create_key

INSTALLED = pytest.mark.skipif(
    not (HOME / "bin" / "pytest").exists(), reason="Home Assistant is not installed; make home-assistant installs it"
)
PERIOD = 600

COLUMNS = ("T_i", "T_out", "u_heat", "setpoint")

RECORD = Path(__file__).with_name("open-windows.csv.xz")
"""Of every period of two weeks: UTC s, the widest opening in W/K, and the unmeasured heat in W as it was published. The
rooms are those of the demo, where windows are opened in the second week only, and "living": its second room as Home
Assistant has one. Made by `tests/support/open_windows.py` of commit e2b83219."""


def configured(folder: Path) -> tuple[Path, Path]:
    """The configuration of a daemon that is posted to, and that of the history in past.csv."""
    limit = {"u_heat": {"aggregate": "mean", "installed": 6000}}
    keys = {"period": "10min", "estimator": "ekf", "setpoint": {"source": "home-assistant", "unit": "degC"}}
    # No posted reading becomes a sample while the test runs.
    zone = sites.zone("living", "home-assistant", limit, lateness="1h", **keys)
    plant = sites.written(folder, {"home-assistant": {"kind": "http"}}, [zone], site={"id": "home"})
    past = {"kind": "csv", "files": ["past.csv"], "timestamp": {"column": "time"}}
    channels = {
        name: {"source": "past", "column": name, "unit": "W" if name == "u_heat" else "degC"} for name in COLUMNS
    }
    zones = [{"id": "living", "setpoint": channels.pop("setpoint"), "channels": channels}]
    (history := folder / "past.toml").write_text(tomli_w.dumps({"sources": {"past": past}, "zones": zones}))
    return plant, history


def record(file: Path, days: int) -> None:
    """The last `days` of a house."""
    outputs, inputs, wanted = recorded(days, PERIOD)
    begin = int(time.time()) // PERIOD * PERIOD - len(wanted) * PERIOD
    with file.open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["time", *COLUMNS])
        for k, ((indoor,), (outdoor, heat), setpoint) in enumerate(zip(outputs, inputs, wanted, strict=True)):
            stamp = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(begin + k * PERIOD))
            rows.writerow([stamp, f"{indoor:.3f}", f"{outdoor:.3f}", f"{heat:.1f}", setpoint])


def in_home_assistant(checks: str, environment: dict[str, str], log: Callable[[], str] = str) -> None:
    """The file `checks` passes inside the real Home Assistant; `log` is shown where it does not."""
    folder = ROOT / "tests" / "deploy" / "home_assistant"
    command = [HOME / "bin" / "python", "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", folder / "pytest.ini"]
    done = subprocess.run(
        [*command, folder / checks], capture_output=True, text=True, env=clean() | environment, timeout=300, check=False
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}\n{log()}"


@INSTALLED
def test_the_integration_in_home_assistant(tmp_path: Path) -> None:
    plant, history = configured(tmp_path)
    record(tmp_path / "past.csv", days=4)
    config = load_history(plant, history)
    learn(config, survey(config, config.zones, None, None), jobs=1)
    scopes: dict[str, Scope] = {"admin": "admin", "short": "admin", "reader": "read"}
    keys = {name: create_key(tmp_path / "state" / "keys.json", name, scope) for name, scope in scopes.items()}
    component = ROOT / "deploy" / "home-assistant" / "custom_components" / "thermogate"
    with Daemon(plant, tmp_path / "log") as daemon:
        site = {"url": daemon.url(), "file": str(plant), "command": [str(THERMOGATE)], "component": str(component)}
        given = {"THERMOGATE_SITE": json.dumps(site | keys), "PYTHONPATH": str(component.parents[1])}
        in_home_assistant("checks.py", given, daemon.log)
    # What the flow shows is a whole configuration, and the history of its zone.
    assert load(tmp_path / "whole.toml").zones[0].id == "attic"
    with pytest.raises(ConfigError, match=r"home-assistant_v2\.db' is not there"):
        load_history(tmp_path / "whole.toml", tmp_path / "history.toml")


@INSTALLED
def test_the_window_rule_finds_openings_and_does_not_cry_wolf(tmp_path: Path) -> None:
    """The automation of docs/home-assistant.md over a week without and a week with open windows of five rooms."""
    page = (ROOT / "docs" / "home-assistant.md").read_text(encoding="utf-8")
    rule = yaml.safe_load(page.partition("<!-- automation: window -->\n```yaml\n")[2].partition("```")[0])
    asked = {"rule": rule, "record": str(RECORD), "alarms": str(tmp_path / "alarms.json")}
    in_home_assistant("weeks.py", {"THERMOGATE_RULE": json.dumps(asked)})
    alarms = json.loads((tmp_path / "alarms.json").read_text())
    with lzma.open(RECORD, "rt", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    opened, found, false = 0, 0, {"without": 0, "with": 0}
    for zone in dict.fromkeys(row["zone"] for row in rows):
        mine = np.array([(int(row["time"]), int(row["opening"])) for row in rows if row["zone"] == zone])
        times, open_ones = mine[:, 0], mine[mine[:, 1] > 0, 0]
        period = times[1] - times[0]
        runs = np.split(open_ones, np.flatnonzero(np.diff(open_ones) > period) + 1)
        windows = [(run[0], run[-1] + period) for run in runs]
        opened += len(windows)
        found += sum(any(begin <= alarm <= end for alarm in alarms[zone]) for begin, end in windows)
        for alarm in alarms[zone]:
            if not any(begin <= alarm <= end for begin, end in windows):
                false["without" if alarm < times[0] + 7 * DAY else "with"] += 1
    assert f"noticed {found} of {opened} openings" in page
    assert false == {"without": 0, "with": 1}


RULES = {
    *("action-setup", "appropriate-polling", "brands", "common-modules", "config-flow", "config-flow-test-coverage"),
    *("dependency-transparency", "docs-actions", "docs-high-level-description", "docs-installation-instructions"),
    *("docs-removal-instructions", "entity-event-setup", "entity-unique-id", "has-entity-name", "runtime-data"),
    *("test-before-configure", "test-before-setup", "unique-config-entry", "action-exceptions"),
    *("config-entry-unloading", "docs-configuration-parameters", "docs-installation-parameters", "entity-unavailable"),
    *("integration-owner", "log-when-unavailable", "parallel-updates", "reauthentication-flow", "test-coverage"),
}
"""Bronze and silver of Home Assistant's quality scale."""


def test_every_rule_of_bronze_and_silver_is_met_or_has_a_reason():
    path = ROOT / "deploy/home-assistant/custom_components/thermogate/quality_scale.yaml"
    rules = yaml.safe_load(path.read_text(encoding="utf-8"))["rules"]
    assert rules.keys() == RULES
    left = {name: rule for name, rule in rules.items() if rule != "done"}
    assert left.keys() == {"brands", "dependency-transparency", "integration-owner", "runtime-data", "test-coverage"}
    assert all(rule["status"] in ("todo", "exempt") and rule["comment"].endswith(".") for rule in left.values())
