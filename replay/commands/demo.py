"""`thermogate demo`: the daemon on a simulated home, recorded or living."""

from __future__ import annotations

import argparse
import socket
import tempfile
from contextlib import nullcontext
from functools import partial
from pathlib import Path

from replay.commands.simulate_bms import LARGEST_PACE, SMALLEST_PACE
from service.cli.arguments import AddCommand, load_config, positive, whole
from service.errors import ConfigError

_DEMO_PACE = 600.0
_HTTP_PORT, _ZENOH_PORT = 8080, 7447


def add_to(add: AddCommand) -> None:
    """Add the command by `add(name, command, text)`."""
    demo = add("demo", _demo, "Run the daemon on a simulated two-zone home, streamed faster than real time.")
    demo.add_argument(
        "--directory", type=Path, metavar="DIR", help="keep files and state here (default: a temporary folder)"
    )
    demo.add_argument(
        "--port",
        type=whole(0, 65535),
        default=_HTTP_PORT,
        metavar="N",
        help="HTTP port, 0 for any free one (default 8080)",
    )
    demo.add_argument(
        "--pace", type=positive, metavar="X", help="multiple of real time (default 1800; live 600, at most 3600)"
    )
    demo.add_argument("--days", type=whole(1, 3660), metavar="N", help="length of the simulated period (default 56)")
    demo.add_argument(
        "--live",
        action="store_true",
        help="a building that lives in its own time, and can be disturbed, instead of a recording",
    )
    demo.add_argument(
        "--duration", type=positive, metavar="SECONDS", help="stop after so many seconds (default: never)"
    )


def _demo(arguments: argparse.Namespace) -> int:
    kept = arguments.directory
    with nullcontext(kept) if kept else tempfile.TemporaryDirectory(prefix="thermogate-demo-") as directory:
        return (_live if arguments.live else _recorded)(Path(directory), arguments)


def _recorded(directory: Path, arguments: argparse.Namespace) -> int:
    """The demo with a recording."""
    from replay.simulated.home import write_demo
    from service.cli.show import demo_requests
    from service.daemon.run import run_daemon

    days, pace = arguments.days or 56, arguments.pace or 1800.0
    config = load_config(arguments, write_demo(directory, days=days, port=arguments.port, pace=pace))
    print("\n".join(demo_requests(config)), flush=True)
    return run_daemon(config, duration=arguments.duration)


def _live(directory: Path, arguments: argparse.Namespace) -> int:
    """The demo with a living building in this process, in its own time, which has lived for a fortnight already."""
    from replay.bms.background import in_background
    from replay.bms.logged import LIVED_DAYS, Demo, live
    from service.cli.show import demo_requests
    from service.daemon.run import run_daemon

    pace = arguments.pace or _DEMO_PACE
    if arguments.days is not None:
        raise ConfigError(["--days is the length of a recording; a --live building has no end, use --duration"])
    if not SMALLEST_PACE <= pace <= LARGEST_PACE:
        raise ConfigError([f"--pace {pace:g}: a --live building lives at {SMALLEST_PACE:g} to {LARGEST_PACE:g}"])
    changes, said = _ports(arguments.port)
    demo = Demo(directory, pace=pace, overrides=tuple(changes))
    with in_background(partial(live, demo)) as (path, control):
        config = load_config(arguments, path)
        room = config.zones[0].id
        said = [
            f"A SYNTHETIC building lives {pace:g} s in each second: a day takes {86_400 / pace / 60:.2g} min. "
            f"The daemon first learns the {LIVED_DAYS} days that it has lived.",
            *said,
            "",
            *demo_requests(config),
            "Open a window for 10 s, or turn a thermostat up, and watch:",
            f"""  curl {control}/faults --json '{{"kind": "window", "device": "{room}", "for": 10}}'""",
            f"""  curl -X PUT {control}/rooms/{room} --json '{{"set_point": 23}}'""",
        ]
        print("\n".join(said), flush=True)
        return run_daemon(config, duration=arguments.duration)


def _ports(wanted: int) -> tuple[list[str], list[str]]:
    """Changes with which the demo starts although its ports may be taken, and what to say of them."""
    changes, said = [f"http.port={wanted}"], []
    if wanted == _HTTP_PORT and _taken(wanted):
        changes, said = ["http.port=0"], [f"Port {wanted} is taken; REST and the page are on a free one."]
    if _taken(_ZENOH_PORT):
        changes.append("zenoh.enabled=false")
        said.append(f"Port {_ZENOH_PORT} is taken, so Zenoh is off in this demo.")
    return changes, said


def _taken(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return True
        return False
