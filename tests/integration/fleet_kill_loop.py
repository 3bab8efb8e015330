"""Machines of a fleet killed at random moments under load, and the fleet held to every number it ever told.

    python tests/integration/fleet_kill_loop.py --kills 50 --zones 2000

The rooms of a campus read one recording on several machines of a Ray cluster, which are process trees on this machine,
over a PostgreSQL server. Clients post to one more room. A machine other than the head is killed at a random moment, or
its shards are, or it is frozen and woken up later; a new machine takes its place. A ledger in a process of its own asks
whatever gateway answers for the newest rows, and syncs each number that it is told to disk. At the end the history must
hold each of them with the same bits; the whole history, the forecasts and the parameters must be those of a daemon on
one machine that was never disturbed; and every reading whose post was answered must be known.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import random
import signal
import sys
import tempfile
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from support.campus import PERIOD, POSTED, rooms, write_recording, write_site
from support.fleet import Cluster, Fleet, get, post_lines, until
from support.harness import Daemon
from support.postgres import server

from service.web.keys import create_key

SITE = f"killed-fleet-{os.getpid()}"
MACHINES = 3
NEWEST = 12
LOOKED_AT = 40
"""Rooms that the ledger and the loop ask for: enough to be on every shard."""
ASKED_AT_ONCE = 8
POST_SECONDS = 0.5
PATIENCE = 200.0
"""s after which something that should come about is given up. With 2,000 rooms on two cores the longest took 71 s,
nearly all of it processor time: the less of that the fleet gets beside other work, the more patience it wants."""
LEARNED = ("forecast?horizon=3h", "parameters")

Row = dict[str, Any]


class Report(NamedTuple):
    """What came of it."""

    kills: dict[str, int]
    """By what was done."""
    zones: int
    acknowledged: int
    """Rows that a gateway told."""
    lost: int
    differing: int
    posts: int
    """Readings whose post was answered."""
    posts_lost: int
    history_rows: int
    history_differing: int
    forecasts_equal: bool
    answered_seconds: list[float]
    """From each kill until every room that was asked forecasts again."""
    recovery_seconds: list[float]
    """From each kill until every room has two newer samples: the wait for the recording's next rows is in it."""
    seconds: float

    @property
    def good(self) -> bool:
        """Whether nothing was lost and nothing differs."""
        return not (self.lost or self.differing or self.posts_lost or self.history_differing) and self.forecasts_equal

    def line(self) -> str:
        """For a person."""
        answered, times = (sorted(one) or [0.0] for one in (self.answered_seconds, self.recovery_seconds))
        return (
            f"{sum(self.kills.values())} disturbances {self.kills} of {self.zones} rooms in {self.seconds:.0f} s; "
            f"{self.acknowledged} rows told: {self.lost} lost, {self.differing} differing; {self.posts} readings "
            f"posted: {self.posts_lost} lost; final history of {self.history_rows} rows: {self.history_differing} "
            f"differing; final forecasts {'equal' if self.forecasts_equal else 'DIFFER'}; every room forecasts again "
            f"after {answered[len(answered) // 2]:.1f} s (median), {answered[-1]:.1f} s (longest), and goes on with "
            f"newer samples after {times[len(times) // 2]:.1f} s (median), {times[-1]:.1f} s (longest)"
        )


def keep_ledger(urls: Path, key: str, zones: list[str], out: Path, stopping: Event) -> None:
    """Ask the gateways in `urls` for the newest rows, over and over, and write what is new to `out`."""
    told: set[str] = set()
    with out.open("a", encoding="utf-8") as file:
        while not stopping.wait(0.05):
            for zone in zones:
                for url in urls.read_text(encoding="utf-8").split():
                    status, body = get(f"{url}/zones/{zone}/history?limit={NEWEST}", key, timeout=5)
                    if status == 200:
                        lines = {json.dumps({"zone": zone, "row": row}, sort_keys=True) for row in body["rows"]} - told
                        told |= lines
                        file.write("".join(f"{line}\n" for line in lines))
                        break
            file.flush()
            os.fsync(file.fileno())


class Loop:
    """One run in `folder`."""

    def __init__(
        self,
        folder: Path,
        kills: int,
        zones: int,
        shards: int,
        seed: int,
        pace: float,
        seconds: float,
        patience: float = PATIENCE,
    ) -> None:
        """`seconds` after which nothing more is killed; `patience`: s that the fleet has for each step."""
        self._patience = patience
        self._folder, self._kills, self._random, self._seconds = folder, kills, random.Random(seed), seconds
        self._rooms, self._shards, self._pace = rooms(zones), shards, pace
        self._looked_at = self._rooms[:: max(1, zones // LOOKED_AT)]
        self._done: Counter[str] = Counter()
        self._answered: list[float] = []
        self._recovery: list[float] = []
        self._posted: list[str] = []
        self._stopping = threading.Event()
        self._urls = folder / "urls"

    def run(self) -> Report:
        """Kill, and look what is left."""
        began = time.monotonic()
        # Long enough for every disturbance; the rest is read in a hurry.
        rows = round(self._pace / PERIOD * 60 * (min(self._kills, self._seconds / 60) + 4))
        write_recording(self._folder / "recording.csv", len(self._rooms), rows)
        with server() as database:
            address = f"postgresql://postgres@/postgres?host={database.folder}"
            self._config = write_site(
                self._folder,
                address,
                site=SITE,
                count=len(self._rooms),
                shards=self._shards,
                pace=self._pace,
                lease=3.0,
                cpus=1.0,
            )
            self._key = create_key(self._folder / "state" / "keys.json", "loop", "admin")
            with Cluster() as cluster:
                for _ in range(MACHINES - 1):
                    cluster.add()
                with Fleet(self._config, cluster.address, self._folder / "fleet.log") as fleet:
                    try:
                        return self._disturb(cluster, fleet, began)
                    except AssertionError:
                        self._explain(cluster, fleet)
                        raise

    def _disturb(self, cluster: Cluster, fleet: Fleet, began: float) -> Report:
        until(lambda: self._look(fleet) and self._is_whole(fleet), "the fleet", self._patience)
        first = self._patience + 5 * PERIOD / self._pace
        until(lambda: min(self._samples().values(), default=0) > 3, "samples of every room", first)
        stopping, out = multiprocessing.Event(), self._folder / "ledger.jsonl"
        arguments = (self._urls, self._key, self._looked_at, out, stopping)
        ledger = multiprocessing.Process(target=keep_ledger, args=arguments, daemon=True)
        ledger.start()
        posting = threading.Thread(target=self._post)
        posting.start()
        try:
            for number in range(self._kills):
                what = self._strike(cluster, fleet)
                took = f"{self._answered[-1]:.1f} s, {self._recovery[-1]:.1f} s"
                print(f"{number + 1}: {what}, {took}, {time.monotonic() - began:.0f} s", flush=True)
                if time.monotonic() - began > self._seconds:
                    break
        finally:
            self._stopping.set()
            posting.join()
        text = self._config.read_text(encoding="utf-8")
        self._config.write_text(text.replace(f"pace = {self._pace}", 'pace = "max"'), encoding="utf-8")
        fleet.process.send_signal(signal.SIGHUP)
        until(lambda: self._look(fleet) and self._has_ended(), "the end of the recording", 6 * self._patience)
        stopping.set()
        ledger.join()
        return self._compared(out, began)

    def _strike(self, cluster: Cluster, fleet: Fleet) -> str:
        """Disturb the fleet, and wait until every room has come further than it had; what was done."""
        choose = self._random
        time.sleep(choose.uniform(0.0, 4.0))
        machine = choose.choice(cluster.others)
        what = choose.choices(("machine killed", "shard killed", "machine frozen"), (70, 15, 15))[0]
        before, at = self._samples(), time.monotonic()
        if what == "machine killed":
            cluster.kill(machine)
        elif what == "machine frozen":
            machine.freeze()
        else:
            shards = fleet.members("shard-")
            os.kill(choose.choice(shards)["pid"], signal.SIGKILL)
        self._done[what] += 1

        def goes_on() -> bool:
            self._look(fleet)
            now = self._samples()
            return bool(now) and all(now.get(room, 0) > before.get(room, 0) + 1 for room in self._rooms)

        silent = set(self._looked_at)
        until(lambda: self._look(fleet) and self._all_forecast(silent), "every room to forecast", self._patience)
        self._answered.append(time.monotonic() - at)
        until(goes_on, "every room to go on", self._patience)
        self._recovery.append(time.monotonic() - at)
        if what == "machine frozen":
            machine.thaw()
            # It finds out that it was given up, and ends.
            time.sleep(2.0)
            cluster.kill(machine)
        while len(cluster.others) < MACHINES - 1:
            cluster.add()
        until(lambda: self._look(fleet) and self._is_whole(fleet), "the fleet to be whole", self._patience)
        return what

    def _explain(self, cluster: Cluster, fleet: Fleet) -> None:
        """Show what is left when a wait was in vain: it is gone with the cluster."""
        print(f"after {dict(self._done)}, load {os.getloadavg()}: {json.dumps(fleet.status())}")
        print(f"{fleet.log()[-3000:]}\n{cluster.log()}", flush=True)

    def _look(self, fleet: Fleet) -> bool:
        """Write down where the gateways are; whether there are any."""
        urls = fleet.urls()
        temporary = self._urls.with_suffix(".tmp")
        temporary.write_text("\n".join(urls), encoding="utf-8")
        temporary.replace(self._urls)
        return bool(urls)

    def _is_whole(self, fleet: Fleet) -> bool:
        return len(fleet.members("gateway-")) >= MACHINES and len(fleet.members("shard-")) == self._shards

    def _asked(self, path: str, timeout: float = 20) -> Any:
        """What the first gateway that answers says; None where none does."""
        for url in self._urls.read_text(encoding="utf-8").split():
            status, body = get(url + path, self._key, timeout)
            if status == 200:
                return body
        return None

    def _samples(self) -> dict[str, int]:
        body = self._asked("/zones", timeout=5)
        return {} if body is None else {z["id"]: z["samples"] for z in body["zones"] if z["id"] != POSTED}

    def _all_forecast(self, silent: set[str]) -> bool:
        """Ask the rooms that are still `silent` for a forecast from their state, and keep those that do not answer."""

        def answers(room: str) -> bool:
            return self._asked(f"/zones/{room}/forecast?horizon=1h", timeout=5) is not None

        asked = sorted(silent)
        with ThreadPoolExecutor(ASKED_AT_ONCE) as pool:
            silent -= {room for room, answered in zip(asked, pool.map(answers, asked), strict=True) if answered}
        return not silent

    def _has_ended(self) -> bool:
        body = self._asked("/zones")
        return body is not None and all(
            "come to an end" in zone["reason"] for zone in body["zones"] if zone["id"] != POSTED
        )

    def _post(self) -> None:
        """Post readings to whatever gateway answers, each until its post is answered."""
        while not self._stopping.wait(POST_SECONDS):
            line = f"{POSTED} T_i=21.5,T_out=4.25,u_heat=900 {time.time_ns()}\n"
            while not self._stopping.is_set():
                urls = self._urls.read_text(encoding="utf-8").split()
                if any(post_lines(f"{url}/readings", line, self._key, timeout=10)[0] == 200 for url in urls):
                    self._posted.append(line)
                    break
                time.sleep(0.2)

    def _compared(self, ledger: Path, began: float) -> Report:
        wrong: Counter[str] = Counter()
        with Daemon(
            self._config,
            self._folder / "daemon.log",
            # Its checkpoints are of no use, and 2,000 rooms would write them for an hour.
            {"site.state_dir": str(self._folder / "alone"), "site.checkpoint_every": 3600, "sources.log.pace": "max"},
        ) as daemon:
            rest = {POSTED}
            daemon.wait(
                lambda zones: all("come to an end" in zones[name]["reason"] for name in zones.keys() - rest), 3600
            )
            rows: dict[str, list[Row]] = {}
            for room in self._rooms:
                rows[room] = self._asked(f"/zones/{room}/history?limit=20000", 60)["rows"]
                alone = daemon.history(room)
                wrong["history"] += sum(one != other for one, other in zip(rows[room], alone, strict=False))
                wrong["history"] += abs(len(rows[room]) - len(alone))
                for path in LEARNED:
                    if self._asked(f"/zones/{room}/{path}", 60) != daemon.get(f"/zones/{room}/{path}")[1]:
                        wrong["learned"] += 1
        told = [json.loads(line) for line in ledger.read_text(encoding="utf-8").splitlines()]
        for entry in told:
            by_time = {row["time"]: row for row in rows[entry["zone"]]} if entry["zone"] in rows else {}
            found = by_time.get(entry["row"]["time"])
            wrong["lost"] += found is None
            wrong["differing"] += found is not None and found != entry["row"]
        for line in self._posted:
            with suppress(TypeError):
                url = self._urls.read_text(encoding="utf-8").split()[0]
                status, taken = post_lines(f"{url}/readings", line, self._key)
                wrong["posts"] += status != 200 or taken["repeated"] != 3
        return Report(
            kills=dict(self._done),
            zones=len(self._rooms),
            acknowledged=len(told),
            lost=wrong["lost"],
            differing=wrong["differing"],
            posts=3 * len(self._posted),
            posts_lost=3 * wrong["posts"],
            history_rows=sum(map(len, rows.values())),
            history_differing=wrong["history"],
            forecasts_equal=not wrong["learned"],
            answered_seconds=[round(seconds, 2) for seconds in self._answered],
            recovery_seconds=[round(seconds, 2) for seconds in self._recovery],
            seconds=time.monotonic() - began,
        )


def main() -> int:
    """Run the loop as the arguments say; 1 if anything was lost or differs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--zones", type=int, default=2000)
    parser.add_argument("--shards", type=int, default=4)
    parser.add_argument("--pace", type=float, default=600.0, help="multiple of real time")
    parser.add_argument("--minutes", type=float, default=math.inf, help="after which nothing more is killed")
    parser.add_argument(
        "--patience", type=float, default=PATIENCE, help="s that the fleet has for each step; more on a busy machine"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="write the report here as JSON")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="thermogate-fleet-kills-") as folder:
        report = Loop(
            Path(folder),
            arguments.kills,
            arguments.zones,
            arguments.shards,
            arguments.seed,
            arguments.pace,
            60 * arguments.minutes,
            arguments.patience,
        ).run()
    if arguments.out is not None:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps(report._asdict(), indent=2) + "\n", encoding="utf-8")
    print(report.line())
    return 0 if report.good else 1


if __name__ == "__main__":
    sys.exit(main())
