"""The daemon fed over HTTP: what it has accepted is there after it was killed, and Telegraf's lines reach the zones."""

import json
import time
from contextlib import closing
from pathlib import Path

from support import sites
from support.harness import Daemon, ask, reload
from support.waiting import wait_until

from service.store.journal import Journal
from service.store.journal_file import JournalFile
from service.web.keys import create_key


class Fed(Daemon):
    """A daemon whose zone "office", with intervals of `period`, is posted to."""

    def __init__(self, folder: Path, period: str, key: str = "") -> None:
        places = {
            "T_i": {"measurement": "mqtt_consumer", "tags": {"topic": "room 1"}},
            "T_out": {"name": "roof"},
            "u_heat": {"unit": "kW"},
        }
        self.config = sites.written(
            folder, {"telegraf": {"kind": "http"}}, [sites.zone("office", "telegraf", places, period=period)]
        )
        secret = key or create_key(folder / "state" / "keys.json", "telegraf", "admin")
        super().__init__(self.config, folder / "log")
        self.key = secret

    def take(self, body: bytes, kind: str = "text/plain; charset=utf-8") -> dict:
        """The answer to a post of readings."""
        status, answer = ask(f"{self.url()}/readings", body, self.key, Content_Type=kind)
        assert status == 200, answer
        return answer


def lines(when: float) -> bytes:
    """What Telegraf posts, as its documentation has it: more than is asked for, and nanoseconds."""
    stamp = int(when * 1e9)
    return (
        f"mqtt_consumer,host=gw-1,topic=room\\ 1 value=21.5 {stamp}\n"
        f"mqtt_consumer,host=gw-1,topic=room\\ 2 value=19.5 {stamp}\n"
        f'cpu,cpu=cpu-total,host=gw-1 usage_idle=97.2,usage_user=1i,note="a, b" {stamp}\n'
        f"office u_heat=1.5 {stamp}\n"
    ).encode()


def test_what_was_accepted_outlives_a_reload_and_a_kill(tmp_path: Path) -> None:
    with Fed(tmp_path, "2s") as daemon:
        while True:
            # Aligned, so that all of it is in one interval, and early in it, so that it is still open.
            when = time.time() // 2 * 2 + 0.25
            pack = json.dumps([{"bn": "", "n": "roof", "u": "Cel", "v": 5.5, "t": when}]).encode()
            first = daemon.take(pack, "application/senml+json")
            second = daemon.take(lines(when))
            if (first["accepted"], second["accepted"]) == (1, 2):
                break
        assert second["unknown"] == 4
        assert second["unknown_names"][:2] == ["mqtt_consumer value", "cpu usage_idle"]
        daemon.kill()
    with Fed(tmp_path, "2s", str(daemon.key)) as again:
        interval = when // 2 * 2
        seen = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(interval))
        again.wait(lambda zones: (zones["office"]["last_sample_time"] or "") >= seen)
        # Its interval has closed meanwhile; it is known all the same.
        assert again.take(lines(when))["repeated"] == 2
        # Of intervals that stay open for hours, over a reload that starts the zone anew.
        config = again.config.read_text()
        for lateness, known in (("3h", 0), ("4h", 2)):
            again.config.write_text(config.replace('period = "2s"', f'period = "2s"\nlateness = "{lateness}"'))
            reload(again, "changed office")
            when = when if known else time.time()
            assert again.take(lines(when))["repeated"] == known
        assert again.status("office")["faults"] == {}
        # Metrics and log tell of it.
        wait_until(lambda: 'thermogate_source_up{source="telegraf"} 1.0' in again.text("/metrics"))
        assert 'thermogate_source_readings_total{source="telegraf"}' in again.text("/metrics")
        assert again.log().count("no channel asks for") == 1
        again.terminate()
    with closing(Journal(JournalFile.open(tmp_path / "state" / "journal.sqlite3"))) as journal:
        (sample,) = (each for each in journal.samples_after("office", None) if each.time == interval)
    assert (*sample.outputs, *sample.inputs) == (21.5, 5.5, 1500.0)
