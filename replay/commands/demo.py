"""`thermogate demo`: the daemon on a simulated building that lives in this process."""

import argparse
import socket
import tempfile
from contextlib import nullcontext
from functools import partial
from pathlib import Path

from replay.commands.options import Option, add_options
from replay.commands.simulate_bms import LARGEST_PACE, SMALLEST_PACE
from service.cli.arguments import AddCommand, load_config, number, positive, whole

_HTTP_PORT, _ZENOH_PORT = 8080, 7447


def add_to(add: AddCommand) -> None:
    demo = add(
        "demo",
        _demo,
        "Run the daemon on a simulated building that runs faster than real time and that you can disturb.",
    )
    demo.add_argument(
        "--directory", type=Path, metavar="DIR", help="keep files and state here (default: a temporary folder)"
    )
    options: dict[str, Option] = {
        "--port": (whole(0, 65535), str(_HTTP_PORT), "N", "HTTP port, 0 for any free one"),
        "--pace": (number(SMALLEST_PACE, LARGEST_PACE), "600", "X", "multiple of real time, at most 3600"),
    }
    add_options(demo, options)
    demo.add_argument(
        "--duration", type=positive, metavar="SECONDS", help="stop after so many seconds (default: never)"
    )


def _demo(arguments: argparse.Namespace) -> int:
    kept = arguments.directory
    with nullcontext(kept) if kept else tempfile.TemporaryDirectory(prefix="thermogate-demo-") as directory:
        return _live(Path(directory), arguments)


def _live(directory: Path, arguments: argparse.Namespace) -> int:
    """The daemon beside a building that has lived for a fortnight already."""
    from replay.bms.background import in_background
    from replay.bms.logged import LIVED_DAYS, Demo, live
    from service.cli.show import demo_requests
    from service.daemon.run import run_daemon

    pace = arguments.pace
    changes, said = ports(arguments.port)
    # Rooms that are configured otherwise learn from the first day on.
    knows = not any(change.strip().startswith(("zones", "site")) for change in arguments.overrides)
    demo = Demo(directory, pace=pace, overrides=tuple(changes), knows=knows)
    with in_background(partial(live, demo)) as (path, control):
        config = load_config(arguments, path)
        room = config.zones[0].id
        said = [
            f"A SYNTHETIC building lives {pace:g} s in each second: a day takes {86_400 / pace / 60:.2g} min. "
            f"The daemon {'knows' if knows else 'first learns'} the {LIVED_DAYS} days that it has lived.",
            *said,
            "",
            *demo_requests(config),
            "Open a window for 10 s, or turn a thermostat up, and watch:",
            f"""  curl {control}/faults --json '{{"kind": "window", "device": "{room}", "for": 10}}'""",
            f"""  curl -X PUT {control}/rooms/{room} --json '{{"set_point": 23}}'""",
        ]
        print("\n".join(said), flush=True)
        return run_daemon(config, duration=arguments.duration)


def ports(wanted: int) -> tuple[list[str], list[str]]:
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
