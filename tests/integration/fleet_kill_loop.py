"""Machines of a fleet killed at random moments under load, and the fleet held to every number it ever told.

    python tests/integration/fleet_kill_loop.py --kills 50 --zones 2000

The rooms of a campus read one recording on several machines of a Ray cluster, which are process trees on this machine,
over a PostgreSQL server. Clients post to one more room. A machine other than the head is killed at a random moment, or
its shards are, or it is frozen and woken up later; a new machine takes its place. A ledger in a process of its own asks
whatever gateway answers for the newest rows, and syncs each number that it is told to disk (`witness.py`). At the end
the history must hold each of them with the same bits; the whole history, the forecasts and the parameters must be those
of a daemon on one machine that was never disturbed; and every reading whose post was answered must be known.
"""

import json
import math
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from integration.command import command
from integration.witness import Ledger, Report, Row, differing, held
from support.campus import PERIOD, POSTED, rooms, write_site
from support.fleet import Cluster, Fleet, get, post_lines, until
from support.harness import Daemon
from support.postgres import server
from support.waiting import repeated

from service.web.keys import create_key

SITE = f"killed-fleet-{os.getpid()}"
MACHINES = 3
LOOKED_AT = 40
"""Rooms that the ledger and the loop ask for: enough to be on every shard."""
ASKED_AT_ONCE = 8
POST_SECONDS = 0.5
CHECKPOINT = 0.06
"""s between two checkpoints of the whole fleet; each takes a processor 13 ms."""
PAUSE = 3.0
"""s between two looks at all rooms: a gateway takes half a second of processor time to list 2,000."""
PATIENCE = 200.0
"""s after which something that should come about is given up. With 2,000 rooms on two cores the longest took 71 s,
nearly all of it processor time: the less of that the fleet gets beside other work, the more patience it wants."""
LEARNED = ("forecast?horizon=3h", "parameters")
FORECASTS, GOES_ON = "every room that was asked forecasts again", "every room has two newer samples"


class Loop:
    """One run in `folder`."""

    def __init__(self, folder: Path, kills: int, zones: int, seed: int, patience: float = PATIENCE) -> None:
        """`patience`: s that the fleet has for each step."""
        self._folder, self._kills, self._patience, self._random = folder, kills, patience, random.Random(seed)
        self._rooms = rooms(zones)
        self._looked_at = self._rooms[:: max(1, zones // LOOKED_AT)]
        self._done: Counter[str] = Counter()
        self._times: dict[str, list[float]] = {FORECASTS: [], GOES_ON: []}
        self._posted: list[str] = []
        self._urls = folder / "urls"

    def run(self, shards: int, pace: float, seconds: float) -> Report:
        """Kill, but nothing after so many `seconds`, and look what is left."""
        self._shards, self._pace = shards, pace
        # Long enough for every disturbance; the rest is read in a hurry.
        rows = round(pace / PERIOD * 60 * (min(self._kills, seconds / 60) + 4))
        with server() as database:
            address = f"postgresql://postgres@/postgres?host={database.folder}"
            count = len(self._rooms)
            loaded = {"pace": pace, "rows": rows, "lease": 3.0, "checkpoint_every": max(2.0, count * CHECKPOINT)}
            self._config = write_site(self._folder, address, site=SITE, count=count, shards=shards, **loaded)
            self._key = create_key(self._folder / "state" / "keys.json", "loop", "admin")
            with Cluster() as cluster:
                for _ in range(MACHINES - 1):
                    cluster.add()
                with Fleet(self._config, cluster.address, self._folder / "fleet.log") as fleet:
                    try:
                        return self._disturb(cluster, fleet, seconds)
                    except AssertionError:
                        # What is left when a wait was in vain is gone with the cluster.
                        print(f"after {dict(self._done)}, load {os.getloadavg()}: {json.dumps(fleet.status())}")
                        print(f"{fleet.log()[-3000:]}\n{cluster.log()}", flush=True)
                        raise

    def _disturb(self, cluster: Cluster, fleet: Fleet, seconds: float) -> Report:
        began = time.monotonic()
        until(lambda: self._look(fleet) and self._is_whole(fleet), "the fleet", self._patience)
        first = self._patience + 5 * PERIOD / self._pace
        until(lambda: min(self._samples().values(), default=0) > 3, "samples of every room", first, PAUSE)
        with Ledger(self._folder / "ledger.jsonl", self._urls, self._looked_at, self._key) as ledger:
            with repeated(self._post, POST_SECONDS):
                for number in range(self._kills):
                    what = self._strike(cluster, fleet)
                    took = ", ".join(f"{times[-1]:.1f} s" for times in self._times.values())
                    print(f"{number + 1}: {what}, {took}, {time.monotonic() - began:.0f} s", flush=True)
                    if time.monotonic() - began > seconds:
                        break
            acknowledged = sum(ledger.read().values())
            text = self._config.read_text(encoding="utf-8")
            self._config.write_text(text.replace(f"pace = {self._pace}", 'pace = "max"'), encoding="utf-8")
            fleet.process.send_signal(signal.SIGHUP)
            until(lambda: self._look(fleet) and self._has_ended(), "the end", 6 * self._patience, PAUSE)
            ledger.close()
            return self._compared(ledger, acknowledged, began)

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
            os.kill(choose.choice(fleet.members("shard-"))["pid"], signal.SIGKILL)
        self._done[what] += 1
        silent = set(self._looked_at)

        def goes_on() -> bool:
            now = self._samples()
            return bool(now) and all(now.get(room, 0) > before.get(room, 0) + 1 for room in self._rooms)

        for what_is, found, pause in ((FORECASTS, lambda: self._all_forecast(silent), 0.5), (GOES_ON, goes_on, PAUSE)):
            until(lambda found=found: self._look(fleet) and found(), what_is, self._patience, pause)
            self._times[what_is].append(round(time.monotonic() - at, 2))
        if what == "machine frozen":
            machine.thaw()
            # It finds out that it was given up, and ends.
            time.sleep(2.0)
            cluster.kill(machine)
        while len(cluster.others) < MACHINES - 1:
            cluster.add()
        until(lambda: self._look(fleet) and self._is_whole(fleet), "the fleet to be whole", self._patience)
        return what

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

    def _told(self) -> list[Row]:
        """What a gateway lists of the rooms."""
        body = self._asked("/zones", timeout=5)
        return [] if body is None else [zone for zone in body["zones"] if zone["id"] != POSTED]

    def _samples(self) -> dict[str, int]:
        return {zone["id"]: zone["samples"] for zone in self._told()}

    def _has_ended(self) -> bool:
        told = self._told()
        return bool(told) and all("come to an end" in zone["reason"] for zone in told)

    def _all_forecast(self, silent: set[str]) -> bool:
        """Ask the rooms that are still `silent` for a forecast from their state, and keep those that do not answer."""

        def answers(room: str) -> bool:
            return self._asked(f"/zones/{room}/forecast?horizon=1h", timeout=5) is not None

        asked = sorted(silent)
        with ThreadPoolExecutor(ASKED_AT_ONCE) as pool:
            silent -= {room for room, answered in zip(asked, pool.map(answers, asked), strict=True) if answered}
        return not silent

    def _post(self) -> None:
        """Post readings to whatever gateway answers; what is not answered is not counted."""
        line = f"{POSTED} T_i=21.5,T_out=4.25,u_heat=900 {time.time_ns()}\n"
        urls = self._urls.read_text(encoding="utf-8").split()
        if any(post_lines(f"{url}/readings", line, self._key, timeout=10)[0] == 200 for url in urls):
            self._posted.append(line)

    def _compared(self, ledger: Ledger, acknowledged: int, began: float) -> Report:
        # Its checkpoints are of no use, and 2,000 rooms would write them for an hour.
        alone = {"site.state_dir": str(self._folder / "alone"), "site.checkpoint_every": 3600}
        rows: dict[str, list[Row]] = {}
        wrong: Counter[str] = Counter()
        with Daemon(self._config, self._folder / "daemon.log", alone) as daemon:
            daemon.wait(lambda zones: all("come to an end" in zones[room]["reason"] for room in self._rooms), 3600)
            for room in self._rooms:
                rows[room] = self._asked(f"/zones/{room}/history?limit=20000", 60)["rows"]
                wrong["history"] += differing(rows[room], daemon.history(room))
                for path in LEARNED:
                    wrong["learned"] += (
                        self._asked(f"/zones/{room}/{path}", 60) != daemon.get(f"/zones/{room}/{path}")[1]
                    )
        wrong += held(ledger.entries, rows)
        url = self._urls.read_text(encoding="utf-8").split()[0]
        for line in self._posted:
            status, taken = post_lines(f"{url}/readings", line, self._key)
            wrong["posts"] += status != 200 or taken["repeated"] != 3
        return Report(
            kills=dict(self._done),
            acknowledged=acknowledged,
            lost=wrong["lost"],
            differing=wrong["differing"],
            history_rows=sum(map(len, rows.values())),
            history_differing=wrong["history"],
            forecasts_equal=not wrong["learned"],
            seconds=time.monotonic() - began,
            posts=3 * len(self._posted),
            posts_lost=3 * wrong["posts"],
            times=self._times,
        )


def run(kills: int, zones: int, shards: int, pace: float, minutes: float, patience: float, seed: int) -> Report:
    with tempfile.TemporaryDirectory(prefix="thermogate-fleet-kills-") as folder:
        return Loop(Path(folder), kills, zones, seed, patience).run(shards, pace, 60 * minutes)


if __name__ == "__main__":
    about = "kill machines of a fleet: --minutes after which nothing more is killed, --patience s for each step"
    settings = {"kills": 50, "zones": 2000, "shards": 4, "pace": 600.0, "minutes": math.inf, "patience": PATIENCE}
    sys.exit(command(about, run, **settings, seed=1))
