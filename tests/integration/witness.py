"""An independent witness of daemons that are killed again and again, and the comparison with what they have at last.

A process of its own asks whatever answers on REST for the newest rows and forecasts, hears what is published on Zenoh,
and writes every number that it is told to a file, synced to disk. A kill loop then holds the daemons to their word.
"""

from __future__ import annotations

import json
import os
import queue
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import zenoh
from support.fleet import get
from support.forked import forking
from support.zenoh_plant import session

POLL_SECONDS = 0.05
NEWEST = 12

Row = dict[str, Any]
"""Of an entry: `zone` and `time` of a history row, those of its columns that were told (`row`), and by what."""


def heard(topic: str, payload: Row) -> Row | None:
    """What a message says of a history row; None for one that says nothing of any."""
    time, own = payload.get("sample_time"), {}
    if topic == "forecast":
        first, time = payload["intervals"][0], payload["valid_time"]
        own = {"lower": first["lower"], "upper": first["upper"], "mean": payload["mean"], "sd": payload["sd"]}
    elif topic == "gate":
        own = {name: payload[name] for name in ("gate", "n_eff", "resampled", "log_likelihood")}
    elif topic == "volatility" and payload["volatility"] is not None:
        alpha = payload["volatility"]
        own = {f"alpha_{name}": alpha[name] for name in ("lower", "median", "upper")} | {"cdf": alpha["cdf"]}
    return {"zone": payload["zone"], "told_by": topic, "time": time, "row": own} if own else None


def told_on_rest(url: str, key: str, zone: str) -> Iterator[Row]:
    """What a daemon or a gateway tells of a zone; nothing where it is killed in the middle, or not there."""
    status, body = get(f"{url}/zones/{zone}/history?limit={NEWEST}", key, timeout=5)
    for row in body["rows"] if status == 200 else ():
        yield {"zone": zone, "told_by": "history", "time": row.pop("time"), "row": row}
    status, body = get(f"{url}/zones/{zone}/forecast", key, timeout=5)
    entry = heard("forecast", body) if status == 200 else None
    if entry is not None:
        yield entry


def _keep(ledger: Ledger, listening: Event, stopping: Event) -> None:
    """Write what is new to the file of `ledger` until `stopping`."""
    entries: queue.SimpleQueue[Row] = queue.SimpleQueue()

    def poll() -> None:
        while not stopping.wait(POLL_SECONDS):
            for zone in ledger.zones:
                for url in ledger.urls.read_text(encoding="utf-8").split():
                    told = list(told_on_rest(url, ledger.key, zone))
                    for entry in told:
                        entries.put(entry)
                    if told:
                        break

    def listen(sample: zenoh.Sample) -> None:
        entry = heard(str(sample.key_expr).rpartition("/")[2], json.loads(sample.payload.to_bytes()))
        if entry is not None:
            entries.put(entry)

    polling = threading.Thread(target=poll)
    with ExitStack() as stack:
        if ledger.endpoint:
            hearing = stack.enter_context(session(listen=ledger.endpoint))
            stack.callback(hearing.declare_subscriber("thermogate/**", listen).undeclare)
        file = stack.enter_context(ledger.file.open("a", encoding="utf-8"))
        polling.start()
        listening.set()
        told: set[str] = set()
        while not stopping.is_set() or polling.is_alive() or not entries.empty():
            time.sleep(0.02)
            # The newest rows are told again and again; a line each is enough, and one more for every difference.
            found = {json.dumps(entries.get(), sort_keys=True) for _ in range(entries.qsize())} - told
            told |= found
            file.write("".join(f"{line}\n" for line in found))
            file.flush()
            os.fsync(file.fileno())


@dataclass
class Ledger:
    """The witness: it asks for `zones` at the addresses in the file `urls`; daemons connect to its `endpoint`, so that
    they may come and go. A context manager that ends the process."""

    file: Path
    urls: Path
    zones: Sequence[str]
    key: str = ""
    endpoint: str = ""

    def __enter__(self) -> Ledger:
        self.entries: list[Row] = []
        self._position, self._scores = 0, set[tuple[str, str]]()
        context = forking()
        listening, self._stopping = context.Event(), context.Event()
        plain = Ledger(self.file, self.urls, self.zones, self.key, self.endpoint)
        self._process = context.Process(target=_keep, args=(plain, listening, self._stopping), daemon=True)
        self._process.start()
        assert listening.wait(180)
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.join()

    def close(self) -> None:
        """Let it write what it has heard."""
        self._stopping.set()
        self._process.join(180)
        self.read()

    def read(self) -> dict[str, int]:
        """Take in what is new in the file; how many scores of each zone were told until now."""
        with self.file.open("rb") as file:
            file.seek(self._position)
            # The last line may be incomplete.
            lines = file.read().rpartition(b"\n")[0].splitlines(keepends=True)
        self._position += sum(map(len, lines)) + bool(lines)
        self.entries += map(json.loads, lines)
        scores = {(one["zone"], one["time"]) for one in self.entries if one["told_by"] != "forecast"}
        return dict.fromkeys(self.zones, 0) | Counter(zone for zone, _ in scores)


def held(entries: Sequence[Row], history: Mapping[str, Sequence[Row]]) -> Counter[str]:
    """How many entries of a ledger are `lost` from the history of their zones, and how many are `differing` there."""
    rows = {(zone, row["time"]): row for zone, found in history.items() for row in found}
    wrong: Counter[str] = Counter(lost=0, differing=0)
    for entry in entries:
        row, forecast = rows.get((entry["zone"], entry["time"])), entry["told_by"] == "forecast"
        if row is None:
            # A forecast of what had not been measured yet has no row; every other entry must have one.
            wrong["lost"] += not forecast
        elif row["mean"] is not None or not forecast:
            wrong["differing"] += any(told != row[name] for name, told in entry["row"].items())
    return wrong


def differing(one: Sequence[Row], other: Sequence[Row]) -> int:
    """Rows that are not in both histories, or are twice in one of them."""
    counts = Counter(json.dumps(row, sort_keys=True) for row in one)
    counts.subtract(Counter(json.dumps(row, sort_keys=True) for row in other))
    return sum(abs(count) for count in counts.values()) + (len(one) - len({row["time"] for row in one}))


@dataclass
class Report:
    """What came of killing."""

    kills: dict[str, int]
    """By what was killed, or what it was doing."""
    acknowledged: int
    """Scores (zone and time) that were told until the last kill."""
    lost: int
    differing: int
    history_rows: int
    history_differing: int
    """Rows that are not those of a daemon that was never killed, or are there twice."""
    forecasts_equal: bool
    seconds: float
    posts: int = 0
    """Readings whose post was answered."""
    posts_lost: int = 0
    times: dict[str, list[float]] = field(default_factory=dict)
    """s from each kill until something was so again."""

    @property
    def good(self) -> bool:
        """Whether nothing was lost and nothing differs."""
        return not (self.lost or self.differing or self.posts_lost or self.history_differing) and self.forecasts_equal

    def lines(self) -> list[str]:
        """For a person."""
        told = [
            f"{sum(self.kills.values())} kills {self.kills} in {self.seconds:.0f} s; {self.acknowledged} scores "
            f"acknowledged until the last: {self.lost} lost, {self.differing} differing; final history of "
            f"{self.history_rows} rows: {self.history_differing} differing; final forecasts "
            f"{'equal' if self.forecasts_equal else 'DIFFER'}"
        ]
        if self.posts:
            told.append(f"{self.posts} readings posted: {self.posts_lost} lost")
        for what, times in self.times.items():
            middle = sorted(times)[len(times) // 2] if times else 0.0
            told.append(f"until {what}: {middle:.1f} s (median), {max(times, default=0.0):.1f} s (longest)")
        return told
