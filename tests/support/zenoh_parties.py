"""The others on Zenoh, each a process of its own: a router, a gateway that publishes readings, one who forges things.

python -m support.zenoh_parties ROLE SETTINGS      SETTINGS: JSON of Zenoh's keys; what it prints first is its verdict
"""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import zenoh
from support.zenoh_plant import caching_publisher, open_session

ROUTER = Path(__file__).parents[2] / "deploy" / "zenoh" / "site-router.json5"
TRUE = {"bms/T": "21", "bms/out": "5", "bms/heat": "400"}
FALSE = {"bms/T": "35", "bms/out": "30", "bms/heat": "9000"}
FORECAST = "thermogate/plant/room/forecast"
FORGED = "forged"


def opened(settings: dict[str, object], base: zenoh.Config | None = None) -> zenoh.Session:
    """A session that waits for the others, or fails."""
    patient = {"connect/timeout_ms": 60_000, "connect/exit_on_failure": True, "scouting/gossip/enabled": False}
    return open_session(patient | settings, base)


def gateway(session: zenoh.Session) -> None:
    """Publish the readings."""
    publishers = {key: caching_publisher(session, key) for key in TRUE}
    while True:
        for key, publisher in publishers.items():
            publisher.put(TRUE[key])
        time.sleep(0.05)


def forger(session: zenoh.Session) -> None:
    """Try everything that would make others take what is not so for a reading or a forecast."""

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr if "*" not in str(query.key_expr) else FORECAST, FORGED)

    handler = zenoh.handlers.Callback(answer, indirect=False)
    kept = [
        session.declare_queryable("thermogate/**", handler),
        session.declare_queryable("bms/**", handler),
        session.liveliness().declare_token("thermogate/plant/forged/alive"),
        *(caching_publisher(session, key) for key in FALSE),
    ]
    while kept:
        for key, value in FALSE.items():
            session.put(key, value)
        for publisher, value in zip(kept[3:], FALSE.values(), strict=True):
            publisher.put(value)
        for topic in ("forecast", "status"):
            session.put(f"thermogate/plant/room/{topic}", FORGED)
            session.delete(f"thermogate/plant/room/{topic}")
        time.sleep(0.02)


def router(session: zenoh.Session) -> None:
    while True:
        time.sleep(1)


ROLES = {"gateway": gateway, "forger": forger, "router": router}


def main(role: str, settings: str) -> None:
    base = zenoh.Config.from_file(str(ROUTER)) if role == "router" else None
    try:
        session = opened(json.loads(settings), base)
    except zenoh.ZError as error:
        print("refused", error, flush=True)
        return
    print("opened", flush=True)
    with session:
        ROLES[role](session)


@contextmanager
def party(role: str, settings: dict[str, object]) -> Iterator[str]:
    """A process in `role`, killed at the end; its verdict."""
    command = [sys.executable, "-m", "support.zenoh_parties", role, json.dumps(settings)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1])
    assert process.stdout is not None
    try:
        yield process.stdout.readline().split(" ", 1)[0].strip()
    finally:
        process.kill()
        process.communicate()


if __name__ == "__main__":
    main(*sys.argv[1:])
