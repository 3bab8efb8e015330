"""Alert rules, scraping and dashboard: every metric that they name is there, and they are well formed."""

import json
import re
import shutil
import subprocess
import urllib.parse
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import yaml
from support.all_metrics import exposed
from support.harness import EXAMPLES, ROOT, Daemon, ask
from support.processes import Program, free_port

DEPLOY = ROOT / "deploy"
PROMETHEUS = DEPLOY / "prometheus"
RULES = yaml.safe_load((PROMETHEUS / "alerts.yml").read_text(encoding="utf-8"))["groups"]
BOARD = json.loads((DEPLOY / "grafana" / "thermogate.json").read_text(encoding="utf-8"))
OPERATIONS = (DEPLOY.parent / "docs" / "operations.md").read_text(encoding="utf-8")

# What Prometheus makes itself, and what its client tells of every process.
OTHERS = {"up", "process_start_time_seconds", "process_cpu_seconds_total", "process_resident_memory_bytes"}


def metrics_in(expression: str) -> set[str]:
    """The names of the metrics in a PromQL expression."""
    bare = re.sub(r'\{[^}]*\}|"[^"]*"|\[[^]]*\]|\b(?:by|without) \([^)]*\)', "", expression)
    words = set(re.findall(r"[a-zA-Z_:][a-zA-Z0-9_:]*(?!\w*\s*\()", bare))
    return {word for word in words if word in OTHERS or word.startswith(("thermogate_", "process_"))}


def known() -> set[str]:
    found = set(OTHERS)
    for name, kind in exposed().items():
        found |= {f"{name}_bucket", f"{name}_sum", f"{name}_count"} if kind == "histogram" else {name}
    return found


def test_alerts_name_metrics_that_exist_and_are_documented() -> None:
    rules, there = [rule for group in RULES for rule in group["rules"]], known()
    for rule in rules:
        assert set() < metrics_in(rule["expr"]) <= there, rule["alert"]
        assert rule["labels"]["severity"] in ("page", "ticket")
        assert rule["annotations"]["summary"]
    documented = set(re.findall(r"`(Thermogate[A-Z]\w+)`", OPERATIONS))
    assert documented == {rule["alert"] for rule in rules}, "what to do about it"


def expressions(node: Any) -> Iterator[str]:
    if isinstance(node, dict):
        yield from (value for key, value in node.items() if key in ("expr", "query") and isinstance(value, str))
        for value in node.values():
            yield from expressions(value)
    elif isinstance(node, list):
        for value in node:
            yield from expressions(value)


def test_the_dashboard_shows_metrics_that_exist() -> None:
    named = set().union(*(metrics_in(expression) for expression in expressions(BOARD)))
    assert len(named) > 20
    assert named <= known()


def test_the_panels_of_the_dashboard_do_not_overlap() -> None:
    taken: set[tuple[int, int]] = set()
    for panel in BOARD["panels"]:
        place = panel["gridPos"]
        cells = {
            (x, y)
            for x in range(place["x"], place["x"] + place["w"])
            for y in range(place["y"], place["y"] + place["h"])
        }
        assert place["x"] + place["w"] <= 24
        assert not cells & taken, panel["title"]
        taken |= cells
    assert len({panel["id"] for panel in BOARD["panels"]}) == len(BOARD["panels"])


needs_prometheus = pytest.mark.skipif(
    shutil.which("promtool") is None or shutil.which("prometheus") is None,
    reason="Prometheus is not installed here (Debian: prometheus)",
)


@needs_prometheus
@pytest.mark.parametrize(
    "arguments",
    [["check", "rules", "alerts.yml"], ["test", "rules", "alerts_test.yml"], ["check", "config", "prometheus.yml"]],
)
def test_promtool_agrees(arguments: list[str]) -> None:
    done = subprocess.run(
        ["promtool", *arguments], cwd=PROMETHEUS, capture_output=True, text=True, timeout=180, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def asked(address: str, path: str, **query: str) -> Any:
    return ask(f"{address}{path}?{urllib.parse.urlencode(query)}")[1]["data"]


@needs_prometheus
def test_prometheus_scrapes_a_daemon_without_keys_and_draws_the_dashboard(tmp_path: Path) -> None:
    """The shipped files as they are, but for the port of the daemon and the time between two scrapes."""
    shutil.copy(PROMETHEUS / "alerts.yml", tmp_path)
    settings: dict[str, object] = {"site.state_dir": str(tmp_path / "state"), "zones.room-1.estimator": "mkf"}
    with Daemon(EXAMPLES / "generic-csv.toml", tmp_path / "daemon.log", settings) as daemon:
        daemon.wait_until_ended()
        shipped = (PROMETHEUS / "prometheus.yml").read_text(encoding="utf-8")
        config, place = tmp_path / "prometheus.yml", f"127.0.0.1:{free_port()}"
        found = shipped.replace("127.0.0.1:8080", daemon.url().removeprefix("http://"))
        config.write_text(found.replace("scrape_interval: 30s", "scrape_interval: 1s"), encoding="utf-8")
        files = [f"--config.file={config}", f"--storage.tsdb.path={tmp_path / 'tsdb'}"]
        command, url = ["prometheus", *files, f"--web.listen-address={place}"], f"http://{place}"

        def scraped() -> bool:
            # It begins with answers that are no JSON.
            with suppress(OSError, ValueError):
                return [row["value"][1] for row in asked(url, "/api/v1/query", query="up")["result"]] == ["1"]
            return False

        with Program(command, tmp_path / "prometheus.log", cwd=tmp_path) as prometheus:
            prometheus.wait_for(scraped)
            (group,) = asked(url, "/api/v1/rules")["groups"]
            assert len(group["rules"]) == sum(len(each["rules"]) for each in RULES)
            panels = {panel["id"]: panel for panel in BOARD["panels"] if panel["type"] != "row"}
            # Temperatures without a set-point, which the recording has not; gain, heat loss, skill and trust.
            panels[29]["targets"].pop()
            prometheus.wait_for(lambda: all(all(shown_by(url, panels[number])) for number in range(29, 34)))
            for panel in panels.values():
                # Prometheus refuses a query that it does not understand.
                shown_by(url, panel)
            prometheus.terminate()


def shown_by(url: str, panel: dict[str, Any]) -> list[int]:
    """How many series each query of a panel has, with everything chosen, and what is drawn later as of now."""
    chosen = (re.sub(r"\$instance|\$zone|\$__all", ".*", query) for query in expressions(panel))
    queries = [query.replace(" offset 6h", "") for query in chosen]
    return [len(asked(url, "/api/v1/query", query=query)["result"]) for query in queries]
