"""Every attack on a live daemon, and a table of what it cost: `make attack`.

    python tests/attack/run.py [--tls] [--only WORD ...]

The daemon reads a Modbus device, a sample a second, and has no keys. Judged are: no answer of /healthz takes longer
than HEALTH_SECONDS in 99 of 100 cases under sixty connections of tiny chunks; no client holds the event loop for more
than HOLD_SECONDS; memory stays within MEMORY_MB of what it is at rest; no live interval is lost. The attackers take
processors as well: on a machine with few of them, or a busy one, times are those of the machine. "wait s" tells how
long the event loop was ready to run and got no processor: where that is much of "s", the machine was late.
"""

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from attack import telemetry, web
from attack.victim import HOLD_SECONDS, MEMORY_MB, Target, Victim, served, use_tls
from support.modbus_plant import WORDS, configuration, plant, running

HEALTH_SECONDS = 0.1


def main() -> int:
    """Run the attacks and print the table; 1 if anything gave way."""
    parser = argparse.ArgumentParser(description="Attack a live daemon.")
    parser.add_argument("--only", nargs="*", default=[""], metavar="WORD", help="attacks whose names contain a word")
    parser.add_argument("--tls", action="store_true", help="over TLS")
    options = parser.parse_args()
    attacks = {name: partial(on_device, attack=attack) for name, attack in web.ATTACKS.items()} | telemetry.ATTACKS
    costs = ("s", 5), ("wait s", 6), ("p99 ms", 7), ("max ms", 7), ("503", 3), ("holds", 5), ("MB", 6), ("lost", 4)
    print(f"processors {os.cpu_count()}, load {os.getloadavg()[0]:.1f}")
    print(f"{'attack':40}", *(f"{cost:>{width}}" for cost, width in costs), " seen")
    failed = 0
    with TemporaryDirectory(prefix="thermogate-attack-") as certificates:
        if options.tls:
            use_tls(Path(certificates))
        for name, prepared in attacks.items():
            if any(word in name for word in options.only):
                # Each on a daemon of its own.
                with TemporaryDirectory(prefix="thermogate-attack-") as own, prepared(Path(own)) as (victim, attack):
                    failed += gave_way(name, victim, attack)
    print(f"{failed} gave way")
    return 1 if failed else 0


@contextmanager
def on_device(folder: Path, attack: Callable[[Target], str]) -> Iterator[tuple[Victim, Callable[[Target], str]]]:
    """A daemon that reads a Modbus device, and an attack of `web`."""
    web.BEFORE.get(attack, lambda folder: None)(folder)
    with running(plant(holding=WORDS)) as site, served(configuration(folder, {"one": site.port}), folder) as daemon:
        daemon.wait(lambda zones: zones["zone-one"]["samples"] >= 5)
        # The kernels of a forecast over many steps are compiled.
        daemon.get("/zones/zone-one/forecast?horizon=10s")
        daemon.get("/zones/zone-one/forecast?level=0.5")
        yield Victim(daemon, "zone-one"), attack


def gave_way(name: str, victim: Victim, attack: Callable[[Target], str]) -> bool:
    """Print what `attack` cost `victim`; whether that was too much."""
    try:
        note, cost = victim.under(attack)
    except (AssertionError, OSError) as error:
        print(f"{name:40} GAVE WAY: {error!r}", flush=True)
        return True
    log = victim.daemon.log()
    given_way = {
        "health": "sixty" in name and cost.p99 > HEALTH_SECONDS,
        f"loop held > {HOLD_SECONDS} s": cost.holds > 0,
        "memory": cost.memory > MEMORY_MB,
        "intervals": cost.lost > 0,
        "traceback": "Traceback" in log,
    }
    bad = [what for what, is_bad in given_way.items() if is_bad]
    figures = f"{cost.seconds:5.1f} {cost.waited:6.1f} {1000 * cost.p99:7.0f} {1000 * cost.longest:7.0f} "
    figures += f"{cost.refused:3} {cost.holds:5} {cost.memory:6.0f} {cost.lost:4}"
    if "traceback" in bad:
        note += log.partition("Traceback")[2]
    print(f"{name:40} {figures}  {f'GAVE WAY: {chr(44).join(bad)}; ' if bad else ''}{note}", flush=True)
    return bool(bad)


if __name__ == "__main__":
    sys.exit(main())
