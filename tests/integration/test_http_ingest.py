"""The daemon fed over HTTP: what it has accepted is there after it was killed, and Telegraf's lines reach the zones."""

from __future__ import annotations

import json
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.harness import Daemon, ask, reload
from support.waiting import wait_until

from service.store.journal import Journal
from service.web.keys import create_key

CONFIG = """
[site]
id = "plant"

[sources.telegraf]
kind = "http"

[[zones]]
id = "office"
period = "{period}"
network = "tite"
estimator_options = {{ particles = 50 }}

[zones.channels]
T_i = {{ source = "telegraf", unit = "degC", measurement = "mqtt_consumer", tags = {{ topic = "room 1" }} }}
T_out = {{ source = "telegraf", unit = "degC", name = "roof" }}
u_heat = {{ source = "telegraf", unit = "kW" }}
"""


class Fed:
    """A daemon and the key to post to it."""

    def __init__(self, daemon: Daemon, key: str, config: Path) -> None:
        self.daemon = daemon
        self.key = key
        self.config = config

    def post(self, path: str, body: bytes, kind: str = "text/plain; charset=utf-8", **headers: str) -> tuple[int, dict]:
        return ask(self.daemon.url() + path, body, self.key, Content_Type=kind, **headers)

    def get(self, path: str) -> dict:
        status, answer = ask(self.daemon.url() + path, key=self.key)
        assert status == 200, answer
        return answer


@contextmanager
def fed(folder: Path, period: str, key: str = "") -> Iterator[Fed]:
    config = folder / "plant.toml"
    config.write_text(CONFIG.format(period=period))
    key = key or create_key(folder / "state" / "keys.json", "telegraf", "admin")
    with Daemon(config, folder / "log", {"site.state_dir": str(folder / "state")}) as daemon:
        yield Fed(daemon, key, config)


def lines(when: float) -> bytes:
    """What Telegraf posts, as its documentation has it: more than is asked for, and nanoseconds."""
    stamp = int(when * 1e9)
    return (
        f"mqtt_consumer,host=gw-1,topic=room\\ 1 value=21.5 {stamp}\n"
        f"mqtt_consumer,host=gw-1,topic=room\\ 2 value=19.5 {stamp}\n"
        f'cpu,cpu=cpu-total,host=gw-1 usage_idle=97.2,usage_user=1i,note="a, b" {stamp}\n'
        f"office u_heat=1.5 {stamp}\n"
    ).encode()


def test_what_was_accepted_is_in_the_sample_although_the_daemon_was_killed(tmp_path: Path) -> None:
    with fed(tmp_path, "2s") as one:
        while True:
            # Aligned, so that all of it is in one interval, and early in it, so that it is still open.
            when = time.time() // 2 * 2 + 0.25
            pack = json.dumps([{"bn": "", "n": "roof", "u": "Cel", "v": 5.5, "t": when}]).encode()
            status, first = one.post("/readings", pack, "application/senml+json")
            assert status == 200, first
            status, second = one.post("/readings", lines(when))
            assert status == 200, second
            if (first["accepted"], second["accepted"]) == (1, 2):
                break
        assert second["unknown"] == 4
        assert second["unknown_names"][:2] == ["mqtt_consumer value", "cpu usage_idle"]
        one.daemon.kill()
        key = one.key
    with fed(tmp_path, "2s", key) as again:
        interval = when // 2 * 2
        seen = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(interval))
        wait_until(lambda: (again.get("/zones")["zones"][0]["last_sample_time"] or "") >= seen, again.daemon.log)
        # Its interval has closed meanwhile; it is known all the same.
        assert again.post("/readings", lines(when))[1]["repeated"] == 2
        assert again.get("/zones/office")["status"]["faults"] == {}
        again.daemon.terminate()
    journal = Journal.open(tmp_path / "state" / "journal.sqlite3")
    (sample,) = (each for each in journal.samples_after("office", None) if each.time == interval)
    journal.close()
    assert (*sample.outputs, *sample.inputs) == (21.5, 5.5, 1500.0)


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fed]:
    """A daemon whose interval stays open all day."""
    with fed(tmp_path_factory.mktemp("fed"), "1d") as running:
        yield running


def day() -> float:
    return time.time() // 86400 * 86400


def test_a_zone_that_a_reload_starts_anew_goes_on_with_what_it_had_accepted(one: Fed) -> None:
    when = day() + 5.0
    assert one.post("/readings", lines(when))[1]["accepted"] == 2
    text = one.config.read_text()
    one.config.write_text(text.replace('network = "tite"', 'network = "tite"\nlateness = "10s"'))
    reload(one.daemon, "changed office")
    assert one.post("/readings", lines(when))[1]["repeated"] == 2
    assert one.get("/zones/office")["status"]["faults"] == {}


def test_metrics_and_log_tell_of_it(one: Fed) -> None:
    request = urllib.request.Request(one.daemon.url() + "/metrics", headers={"Authorization": f"Bearer {one.key}"})
    one.post("/readings", lines(day() + 2.0))
    deadline = time.monotonic() + 180
    text = ""
    while 'thermogate_source_up{source="telegraf"} 1.0' not in text:
        assert time.monotonic() < deadline, text
        with urllib.request.urlopen(request, timeout=180) as answer:
            text = answer.read().decode()
    assert 'thermogate_source_readings_total{source="telegraf"}' in text
    assert one.daemon.log().count("no channel asks for") == 1
