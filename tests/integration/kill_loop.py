"""The daemon killed with SIGKILL at random moments under load, and held to every number it ever told.

    python tests/integration/kill_loop.py --kills 500

Three zones read one recording, some dozens of samples a second each, with several checkpoints a second. The kills fall
into the start, the load and the stop. A ledger in a process of its own (`kill_ledger.py`) records every number that
REST and Zenoh report. A daemon under load is killed only after the ledger has new scores of every zone, so that every
such kill puts scores at stake, however slow the machine is. After every restart that serves, and at the end, the
history must hold each entry of the ledger with the same bits. At the end, the whole history, the forecasts and the
parameters must be those of a daemon that was never killed.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from support.harness import Daemon, free_port, thermogate

ZONES = {"north": ("rbpf", 60), "south": ("rbpf", 120), "attic": ("ekf", 60)}
"""Estimator and period in s."""
START = 1_746_230_400
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

Row = dict[str, Any]


class Report(NamedTuple):
    """What came of it."""

    kills: int
    moments: dict[str, int]
    """Kills by what the daemon was doing."""
    acknowledged: int
    """Scores (zone and time) that REST or Zenoh told until the last kill."""
    entries: int
    """Lines of the ledger at the end."""
    lost: int
    differing: int
    history_rows: int
    history_differing: int
    """Rows that are not those of the uninterrupted daemon, or are there twice."""
    forecasts_equal: bool
    replayed: int
    """Intervals that starts took from the journal."""
    seconds: float

    @property
    def good(self) -> bool:
        """Whether nothing was lost and nothing differs."""
        return not (self.lost or self.differing or self.history_differing) and self.forecasts_equal

    def line(self) -> str:
        """For a person."""
        equal = "equal" if self.forecasts_equal else "DIFFER"
        return (
            f"{self.kills} kills in {self.seconds:.0f} s; {self.acknowledged} scores acknowledged until the last: "
            f"{self.lost} lost, {self.differing} differing; final history of {self.history_rows} rows: "
            f"{self.history_differing} differing; final forecasts {equal}"
        )


def write_site(folder: Path, rows: int) -> Path:
    """A recording of `rows` minutes for every zone, and the configuration that reads it."""
    table = ["time,T_out,heat," + ",".join(ZONES)]
    for k in range(rows):
        outdoor = 5 + 6 * math.sin(k / 220)
        heat = 1500.0 * ((k // 25) % 3 == 0)
        indoor = [
            20 + math.sin(k / 90 + i) + 0.05 * math.sin(7.3 * k * (i + 1)) + heat / 4000 for i in range(len(ZONES))
        ]
        # Now and then a zone has no measurement, for short or for longer than is bridged.
        shown = [f"{v:.3f}" if (k + 97 * i) % 311 > 9 + 9 * (k % 5 == 0) else "" for i, v in enumerate(indoor)]
        table.append(f"{START + 60 * k},{outdoor:.3f},{heat:.0f},{','.join(shown)}")
    (folder / "recording.csv").write_text("\n".join(table) + "\n", encoding="utf-8")
    zones = "".join(
        f"""
[[zones]]
id = "{zone}"
period = {period}
network = "tite"
estimator = "{estimator}"
{"estimator_options = { particles = 50 }" if estimator == "rbpf" else ""}
[zones.channels]
T_i    = {{ source = "log", column = "{zone}", unit = "degC" }}
T_out  = {{ source = "log", column = "T_out", unit = "degC" }}
u_heat = {{ source = "log", column = "heat", unit = "W" }}
"""
        for zone, (estimator, period) in ZONES.items()
    )
    path = folder / "site.toml"
    path.write_text(
        f"""
[site]
id = "killed"
checkpoint_every = 0.3

[sources.log]
kind = "csv"
files = ["recording.csv"]
timestamp = {{ column = "time", format = "epoch" }}
{zones}""",
        encoding="utf-8",
    )
    return path


class Loop:
    """One run of the loop in `folder`."""

    def __init__(self, folder: Path, kills: int, seed: int) -> None:
        self._folder, self._kills, self._random = folder, kills, random.Random(seed)
        self._config = write_site(folder, ROWS_PER_KILL * kills + 200)
        self._port, self._endpoint = free_port(), f"tcp/127.0.0.1:{free_port()}"
        self._ledger = folder / "ledger.jsonl"
        self._position = 0
        """How much of the ledger has been read, in bytes."""
        self._entries: list[Row] = []
        self._held = 0
        """How many of the entries have been compared with the history."""
        self._scores: dict[str, set[str]] = {zone: set() for zone in ZONES}
        """Times of the acknowledged scores, by zone."""
        self._startup = 1.5
        self._replayed = 0
        self._wrong: Counter[str] = Counter()

    def run(self, progress: bool) -> Report:
        """Kill, and look what is left."""
        # The first start on a machine compiles the kernels, for longer than a start may take here.
        warm = thermogate("replay", self._config, "--out", self._folder / "warm", "--end", "2025-05-03T00:20:00Z")
        assert warm.returncode == 0, warm.stderr
        began, moments = time.monotonic(), Counter[str]()
        command = [sys.executable, Path(__file__).with_name("kill_ledger.py"), "--endpoint", self._endpoint]
        command += ["--url", f"http://127.0.0.1:{self._port}", "--out", self._ledger, "--zones", *ZONES]
        ledger = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            assert ledger.stdout is not None
            assert ledger.stdout.readline() == "listening\n"
            for number in range(self._kills):
                moments[self._kill()] += 1
                if progress and (number + 1) % 10 == 0:
                    print(f"{number + 1} kills, {time.monotonic() - began:.0f} s", flush=True)
            acknowledged = sum(self._acknowledged().values())
            with self._daemon({"sources.log.pace": "max"}) as daemon:
                daemon.wait_until_ended()
                # What the daemon announced last may still be on its way.
                time.sleep(0.3)
                ledger.terminate()
                ledger.wait(60)
                self._held = 0
                self._hold_to_ledger(daemon)
                killed = state_of(daemon)
        finally:
            ledger.kill()
            ledger.communicate()
        alone = {"sources.log.pace": "max", "site.state_dir": str(self._folder / "alone")}
        with self._daemon(alone | {"zenoh.enabled": False, "http.port": 0}) as daemon:
            daemon.wait_until_ended()
            straight = state_of(daemon)
        return Report(
            kills=self._kills,
            moments=dict(moments),
            acknowledged=acknowledged,
            entries=len(self._entries),
            lost=self._wrong["lost"],
            differing=self._wrong["differing"],
            history_rows=sum(len(history) for history, *_ in straight.values()),
            history_differing=sum(differing(killed[zone][0], straight[zone][0]) for zone in ZONES),
            forecasts_equal=all(killed[zone][1:] == straight[zone][1:] for zone in ZONES),
            replayed=self._replayed,
            seconds=time.monotonic() - began,
        )

    def _daemon(self, settings: dict[str, object]) -> Daemon:
        chosen = {
            "site.state_dir": str(self._folder / "state"),
            "http.port": self._port,
            "zenoh.enabled": True,
            "zenoh.listen": [],
            "zenoh.connect": [self._endpoint],
        }
        return Daemon(self._config, self._folder / "daemon.log", chosen | settings)

    def _kill(self) -> str:
        """Start the daemon, kill it, and return what it was doing."""
        choose = self._random
        moment = choose.choices(("start", "load", "stop"), (15, 70, 15))[0]
        with self._daemon({"sources.log.pace": PACE}) as daemon:
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
            log = daemon.log()
            assert "Traceback" not in log, log
            assert code is None or (moment, code) == ("stop", 0), log
            self._replayed += sum(int(word) for word in _replays(log))
            return moment if code is None else "stopped just before"

    def _wait_for_scores(self, daemon: Daemon, count: int) -> None:
        """Return once the ledger has `count` more scores of every zone."""
        before, deadline = self._acknowledged(), time.monotonic() + PATIENCE
        while min(now - before[zone] for zone, now in self._acknowledged().items()) < count:
            assert daemon.process.poll() is None, daemon.log()
            assert time.monotonic() < deadline, f"no {count} scores of every zone in {PATIENCE} s; {daemon.log()}"
            time.sleep(0.01)

    def _acknowledged(self) -> dict[str, int]:
        """How many scores of each zone the ledger has."""
        with self._ledger.open("rb") as file:
            file.seek(self._position)
            # The last line may be incomplete.
            lines = file.read().rpartition(b"\n")[0].splitlines(keepends=True)
        self._position += sum(map(len, lines)) + bool(lines)
        for line in lines:
            entry = json.loads(line)
            self._entries.append(entry)
            if entry["told_by"] != "forecast":
                self._scores[entry["zone"]].add(entry["time"])
        return {zone: len(times) for zone, times in self._scores.items()}

    def _hold_to_ledger(self, daemon: Daemon) -> None:
        """Compare the entries that are new in the ledger with the history."""
        self._acknowledged()
        entries = self._entries[self._held :]
        self._held = len(self._entries)
        for zone in ZONES:
            of_zone = [entry for entry in entries if entry["zone"] == zone]
            if not of_zone:
                continue
            history = {row["time"]: row for row in history_of(daemon, zone, min(entry["time"] for entry in of_zone))}
            for entry in of_zone:
                row = history.get(entry["time"])
                if row is None:
                    # A forecast of what had not been measured yet has no row; every other entry must have one.
                    self._wrong["lost"] += entry["told_by"] != "forecast"
                elif row["mean"] is not None or entry["told_by"] != "forecast":
                    told = entry["row"]
                    self._wrong["differing"] += any(told[name] != row[name] for name in told)


def _replays(log: str) -> Iterator[str]:
    for line in log.splitlines():
        if "intervals replayed from the journal" in line:
            yield line.split(" samples, ")[1].split()[0]


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


def differing(one: list[Row], other: list[Row]) -> int:
    """Rows that are not in both lists, or are twice in one of them."""
    counts = Counter(json.dumps(row, sort_keys=True) for row in one)
    counts.subtract(Counter(json.dumps(row, sort_keys=True) for row in other))
    return sum(abs(count) for count in counts.values()) + (len(one) - len({row["time"] for row in one}))


def main() -> int:
    """Run the loop as the arguments say; 1 if anything was lost or differs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="write the report here as JSON")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="thermogate-kills-") as folder:
        report = Loop(Path(folder), arguments.kills, arguments.seed).run(progress=True)
    if arguments.out is not None:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps(report._asdict(), indent=2) + "\n", encoding="utf-8")
    print(report.line())
    return 0 if report.good else 1


if __name__ == "__main__":
    sys.exit(main())
