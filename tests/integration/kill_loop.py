"""The daemon killed with SIGKILL at random moments under load, and held to every number it ever told.

    python tests/integration/kill_loop.py --kills 500

Three zones read one recording, some dozens of samples a second each, with several checkpoints a second. The kills fall
into the start, the load and the stop. A ledger in a process of its own (`witness.py`) records every number that REST
and Zenoh report. A daemon under load is killed only after the ledger has new scores of every zone, so that every such
kill puts scores at stake, however slow the machine is. After every restart that serves, and at the end, the history
must hold each entry of the ledger with the same bits. At the end, the whole history, the forecasts and the parameters
must be those of a daemon that was never killed.
"""

import random
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from integration.command import command
from integration.witness import Ledger, Report, Row, differing, held
from support import sites
from support.harness import Daemon, thermogate
from support.processes import free_port
from support.zenoh_plant import endpoint

ZONES = {"north": ("rbpf", 60), "south": ("rbpf", 120), "attic": ("ekf", 60)}
"""Estimator and period in s."""
PACE = 4800.0
ROWS_PER_KILL = 60
"""Rows of the recording for each kill: more than the zones read between two kills."""
SCORES = (4, 16)
"""How many new scores of every zone the ledger must have before a kill under load: at least, and at most."""
FURTHER_SECONDS = 0.3
"""The kill then comes at a random moment within this time."""
PATIENCE = 300.0
"""Seconds after which a daemon or a ledger that makes no progress fails the loop."""
PAGE = 10_000


def write_site(folder: Path, rows: int) -> Path:
    """A recording of `rows` minutes for every zone, and the configuration that reads it."""
    # Now and then a zone has no measurement for longer than is bridged.
    log = sites.recording(folder / "recording.csv", list(ZONES), rows, 60, (311, 14))
    zones = []
    for name, (estimator, period) in ZONES.items():
        few = {"estimator_options": {"particles": 50}} if estimator == "rbpf" else {}
        zones.append(sites.recorded(name, period=period, estimator=estimator, **few))
    return sites.written(folder, {"log": log}, zones, site={"id": "killed", "checkpoint_every": 0.3})


class Loop:
    """One run of the loop in `folder`."""

    def __init__(self, folder: Path, kills: int, seed: int) -> None:
        self._folder, self._kills, self._random = folder, kills, random.Random(seed)
        self._config = write_site(folder, ROWS_PER_KILL * kills + 200)
        self._port, place = free_port(), endpoint()
        urls = folder / "urls"
        urls.write_text(f"http://127.0.0.1:{self._port}", encoding="utf-8")
        self._ledger = Ledger(folder / "ledger.jsonl", urls, list(ZONES), endpoint=place)
        self._live = {"http.port": self._port, "zenoh.enabled": True, "zenoh.listen": [], "zenoh.connect": [place]}
        self._held = 0
        """How many of the ledger's entries have been compared with the history."""
        self._startup = 1.5
        self._wrong: Counter[str] = Counter()

    def run(self) -> Report:
        """Kill, and look what is left."""
        # The first start on a machine compiles the kernels, for longer than a start may take here.
        warm = thermogate("replay", self._config, "--out", self._folder / "warm", "--end", "2025-05-03T00:20:00Z")
        assert warm.returncode == 0, warm.stderr
        began, moments = time.monotonic(), Counter[str]()
        with self._ledger as ledger:
            for number in range(self._kills):
                moments[self._kill()] += 1
                if (number + 1) % 10 == 0:
                    print(f"{number + 1} kills, {time.monotonic() - began:.0f} s", flush=True)
            acknowledged = sum(ledger.read().values())
            with self._daemon("max") as daemon:
                daemon.wait_until_ended()
                # What the daemon announced last may still be on its way.
                time.sleep(0.3)
                ledger.close()
                self._held = 0
                self._hold_to_ledger(daemon)
                killed = state_of(daemon)
        alone = {"site.state_dir": str(self._folder / "alone"), "zenoh.enabled": False, "http.port": 0}
        with self._daemon("max", **alone) as daemon:
            daemon.wait_until_ended()
            straight = state_of(daemon)
        return Report(
            kills=dict(moments),
            acknowledged=acknowledged,
            lost=self._wrong["lost"],
            differing=self._wrong["differing"],
            history_rows=sum(len(history) for history, *_ in straight.values()),
            history_differing=sum(differing(killed[zone][0], straight[zone][0]) for zone in ZONES),
            forecasts_equal=all(killed[zone][1:] == straight[zone][1:] for zone in ZONES),
            seconds=time.monotonic() - began,
        )

    def _daemon(self, pace: object, **settings: object) -> Daemon:
        return Daemon(self._config, self._folder / "log", self._live | {"sources.log.pace": pace} | settings)

    def _kill(self) -> str:
        """Start the daemon, kill it, and return what it was doing."""
        choose = self._random
        moment = choose.choices(("start", "load", "stop"), (15, 70, 15))[0]
        with self._daemon(PACE) as daemon:
            began = time.monotonic()
            if moment == "start":
                # From the first import to the moment at which it serves, and a little beyond.
                time.sleep(choose.uniform(0.2, 1.1) * self._startup)
            else:
                daemon.url()
                self._startup = 0.8 * self._startup + 0.2 * (time.monotonic() - began)
                self._hold_to_ledger(daemon)
                self._wait_for_scores(daemon, choose.randint(*SCORES))
                time.sleep(choose.uniform(0.0, FURTHER_SECONDS))
            if moment == "stop":
                daemon.process.terminate()
                time.sleep(choose.uniform(0.0, 0.15))
            code = daemon.process.poll()
            daemon.kill()
            assert "Traceback" not in daemon.log(), daemon.log()
            assert code is None or (moment, code) == ("stop", 0), daemon.log()
            return moment if code is None else "stopped just before"

    def _wait_for_scores(self, daemon: Daemon, count: int) -> None:
        """Return once the ledger has `count` more scores of every zone."""
        before = self._ledger.read()
        daemon.wait_for(lambda: all(now - before[zone] >= count for zone, now in self._ledger.read().items()), PATIENCE)

    def _hold_to_ledger(self, daemon: Daemon) -> None:
        """Compare the entries that are new in the ledger with the history."""
        self._ledger.read()
        entries = self._ledger.entries[self._held :]
        self._held = len(self._ledger.entries)
        first: dict[str, str] = {}
        for entry in entries:
            first[entry["zone"]] = min(entry["time"], first.get(entry["zone"], entry["time"]))
        self._wrong += held(entries, {zone: history_of(daemon, zone, time) for zone, time in first.items()})


def history_of(daemon: Daemon, zone: str, start: str) -> list[Row]:
    """Every history row of `zone` from `start` on."""
    found: list[Row] = []
    end = ""
    while True:
        status, body = daemon.get(f"/zones/{zone}/history?limit={PAGE}&start={start}{end}")
        assert status == 200, body
        found = body["rows"] + found
        if len(body["rows"]) < PAGE:
            return found
        end = f"&end={body['rows'][0]['time']}"


def state_of(daemon: Daemon) -> dict[str, tuple[list[Row], Row, Row]]:
    """History, forecast and parameters of every zone."""
    return {
        zone: (
            history_of(daemon, zone, "1970-01-01T00:00:00Z"),
            daemon.get(f"/zones/{zone}/forecast?horizon=1h")[1],
            daemon.get(f"/zones/{zone}/parameters")[1],
        )
        for zone in ZONES
    }


def run(kills: int, seed: int) -> Report:
    with tempfile.TemporaryDirectory(prefix="thermogate-kills-") as folder:
        return Loop(Path(folder), kills, seed).run()


if __name__ == "__main__":
    sys.exit(command("kill the daemon at random moments under load", run, kills=500, seed=1))
