"""An independent witness of a daemon that is killed again and again.

It hears the daemon on Zenoh, polls it on REST, and writes every number that it was told to a file of its own, synced to
disk. The kill loop then holds the daemon to its word. The daemon connects here, so that it may come and go.

    python tests/integration/kill_ledger.py --endpoint tcp/127.0.0.1:7500 --url http://127.0.0.1:8085 --out ledger.jsonl
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import json
import os
import queue
import signal
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import zenoh

POLL_SECONDS = 0.05
NEWEST = 12

Entry = dict[str, Any]
"""`zone` and `time` of a history row, and those of its columns that were told."""


def heard(topic: str, payload: Entry) -> Entry | None:
    """What a message says of a history row; None for one that says nothing of any."""
    entry: Entry = {"zone": payload["zone"], "told_by": topic}
    if topic == "forecast":
        first = payload["intervals"][0]
        own = {"lower": first["lower"], "upper": first["upper"], "mean": payload["mean"], "sd": payload["sd"]}
        return entry | {"time": payload["valid_time"], "row": own}
    if topic == "gate":
        own = {name: payload[name] for name in ("gate", "n_eff", "resampled", "log_likelihood")}
        return entry | {"time": payload["sample_time"], "row": own}
    if topic == "volatility" and payload["volatility"] is not None:
        alpha = payload["volatility"]
        own = {f"alpha_{name}": alpha[name] for name in ("lower", "median", "upper")} | {"cdf": alpha["cdf"]}
        return entry | {"time": payload["sample_time"], "row": own}
    return None


def poll(url: str, zones: list[str], entries: queue.SimpleQueue[Entry], stopping: threading.Event) -> None:
    """Ask REST for the newest rows and the standing forecast, over and over; one that is not there is passed over."""
    while not stopping.wait(POLL_SECONDS):
        # Killed in the middle of an answer, or not there yet.
        with contextlib.suppress(OSError, http.client.HTTPException, ValueError):
            for zone in zones:
                with urllib.request.urlopen(f"{url}/zones/{zone}/history?limit={NEWEST}", timeout=5) as answer:
                    for row in json.load(answer)["rows"]:
                        entries.put({"zone": zone, "told_by": "history", "time": row.pop("time"), "row": row})
                with urllib.request.urlopen(f"{url}/zones/{zone}/forecast", timeout=5) as answer:
                    entry = heard("forecast", json.load(answer))
                    assert entry is not None
                    entries.put(entry)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--url", required=True)
    parser.add_argument("--zones", nargs="+", required=True)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    stopping = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stopping.set())
    entries: queue.SimpleQueue[Entry] = queue.SimpleQueue()

    def listen(sample: zenoh.Sample) -> None:
        entry = heard(str(sample.key_expr).rpartition("/")[2], json.loads(sample.payload.to_bytes()))
        if entry is not None:
            entries.put(entry)

    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("listen/endpoints", json.dumps([arguments.endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    polling = threading.Thread(target=poll, args=(arguments.url, arguments.zones, entries, stopping))
    with zenoh.open(config) as session, arguments.out.open("a", encoding="utf-8") as file:
        subscriber = session.declare_subscriber("thermogate/**", listen)
        polling.start()
        print("listening", flush=True)
        told: set[str] = set()
        while not stopping.is_set() or not entries.empty():
            time.sleep(0.02)
            lines = []
            while not entries.empty():
                # The newest rows are told again and again; a line each is enough, and one more for every difference.
                line = json.dumps(entries.get(), sort_keys=True)
                if line not in told:
                    told.add(line)
                    lines.append(line)
            if lines:
                file.write("".join(f"{line}\n" for line in lines))
                file.flush()
                os.fsync(file.fileno())
        subscriber.undeclare()
        polling.join()


if __name__ == "__main__":
    main()
