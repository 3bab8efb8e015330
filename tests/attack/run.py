"""Every attack on a live daemon, and a table of what it cost: `make attack`.

    python tests/attack/run.py [--only WORD ...] [--tls]

The daemon reads a Modbus device, a sample a second, and has no keys. Judged are: no answer of /healthz takes longer
than HEALTH_SECONDS in 99 of 100 cases under sixty connections of tiny chunks; no client holds the event loop for more
than HOLD_SECONDS; memory stays within MEMORY_MB of what it is at rest; no live interval is lost. The attackers take
processors as well: on a machine with few of them, or a busy one, times are those of the machine. "wait s" tells how
long the event loop was ready to run and got no processor: where that is much of "s", the machine was late.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from attack import telemetry, web
from attack.victim import HOLD_SECONDS, MEMORY_MB, Target, Victim
from support.certificates import make_pair
from support.harness import Daemon
from support.modbus_plant import WORDS, configuration, plant, running

HEALTH_SECONDS = 0.1


def main() -> int:
    """Run the attacks and print the table; 1 if anything gave way."""
    parser = argparse.ArgumentParser(description="Attack a live daemon.")
    parser.add_argument("--only", nargs="*", default=[], metavar="WORD", help="attacks whose names contain a word")
    parser.add_argument("--tls", action="store_true", help="over TLS")
    arguments = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="thermogate-attack-"))
    try:
        print(f"processors {os.cpu_count()}, load {os.getloadavg()[0]:.1f}")
        failed = over_http(folder, arguments.only, arguments.tls)
        failed += by_publishers(folder, arguments.only)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    print(f"{failed} gave way")
    return 1 if failed else 0


def over_http(folder: Path, only: list[str], encrypted: bool) -> int:
    """The attacks of `web`, each on a daemon of its own; how many succeeded."""
    failed = 0
    costs = ("s", 5), ("wait s", 6), ("p99 ms", 7), ("max ms", 7), ("503", 3), ("holds", 5), ("MB", 6), ("lost", 4)
    print(f"{'attack':40}", *(f"{cost:>{width}}" for cost, width in costs), " seen")
    for index, (name, attack) in enumerate(_chosen(web.ATTACKS, only)):
        place = folder / f"web-{index}"
        place.mkdir()
        web.BEFORE.get(attack, lambda folder: None)(place)
        pair = make_pair(place)
        settings: dict[str, object] = {}
        if encrypted:
            settings = {"http.certificate": str(pair.certificate), "http.private_key": str(pair.private_key)}
        with (
            running(plant(holding=WORDS)) as site,
            Daemon(configuration(place, {"one": site.port}), place / "log", settings) as daemon,
        ):
            wait_for_samples(daemon, encrypted)
            failed += gave_way(name, Victim(daemon, None if encrypted else "zone-one"), attack)
    return failed


def by_publishers(folder: Path, only: list[str]) -> int:
    """The attacks of `telemetry`, each on a daemon of its own; how many succeeded."""
    failed = 0
    for index, (name, prepared) in enumerate(_chosen(telemetry.ATTACKS, only)):
        place = folder / f"telemetry-{index}"
        place.mkdir()
        with prepared(place) as (daemon, attack):
            failed += gave_way(name, Victim(daemon, "honest"), attack)
    return failed


def gave_way(name: str, victim: Victim, attack: Callable[[Target], str]) -> bool:
    """Print what `attack` cost `victim`; whether that was too much."""
    try:
        note, cost = victim.under(attack)
    except (AssertionError, OSError) as error:
        print(f"{name:40} GAVE WAY: {error!r}", flush=True)
        return True
    log = victim.daemon.log()
    bad = [
        what
        for what, is_bad in (
            ("health", "sixty" in name and cost.p99 > HEALTH_SECONDS),
            (f"loop held > {HOLD_SECONDS} s", cost.holds > 0),
            ("memory", cost.memory > MEMORY_MB),
            ("intervals", cost.lost > 0),
            ("traceback", "Traceback" in log),
        )
        if is_bad
    ]
    figures = f"{cost.seconds:5.1f} {cost.waited:6.1f} {1000 * cost.p99:7.0f} {1000 * cost.longest:7.0f} "
    figures += f"{cost.refused:3} {cost.holds:5} {cost.memory:6.0f} {cost.lost:4}"
    if "traceback" in bad:
        note += log.partition("Traceback")[2]
    print(f"{name:40} {figures}  {f'GAVE WAY: {chr(44).join(bad)}; ' if bad else ''}{note}", flush=True)
    return bool(bad)


def wait_for_samples(daemon: Daemon, encrypted: bool) -> None:
    """Until the zone runs, and the kernels of a forecast over many steps are compiled."""
    daemon.url()
    if encrypted:
        time.sleep(20)
        return
    daemon.wait(lambda zones: zones["zone-one"]["samples"] >= 5)
    daemon.get("/zones/zone-one/forecast?horizon=10s")
    daemon.get("/zones/zone-one/forecast?level=0.5")


def _chosen(attacks, only):  # type: ignore[no-untyped-def]
    return [(name, attack) for name, attack in attacks.items() if not only or any(word in name for word in only)]


if __name__ == "__main__":
    sys.exit(main())
