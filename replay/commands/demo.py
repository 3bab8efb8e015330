"""`thermogate demo`: the daemon on a simulated home, recorded or living."""

from __future__ import annotations

import argparse
import tempfile
from contextlib import nullcontext
from pathlib import Path

from replay.commands.simulate_bms import LARGEST_PACE, SMALLEST_PACE
from service.cli.arguments import AddCommand, load_config, positive, whole
from service.errors import ConfigError

_DEMO_PACE = 600.0


def add_to(add: AddCommand) -> None:
    """Add the command by `add(name, command, text)`."""
    demo = add("demo", _demo, "Run the daemon on a simulated two-zone home, streamed faster than real time.")
    demo.add_argument(
        "--directory", type=Path, metavar="DIR", help="keep files and state here (default: a temporary folder)"
    )
    demo.add_argument(
        "--port", type=whole(0, 65535), default=8080, metavar="N", help="HTTP port, 0 for any free one (default 8080)"
    )
    demo.add_argument(
        "--pace", type=positive, metavar="X", help="multiple of real time (default 1800; live 600, at most 3600)"
    )
    demo.add_argument("--days", type=whole(1, 3660), metavar="N", help="length of the simulated period (default 56)")
    demo.add_argument(
        "--live", action="store_true", help="read a simulated building over Modbus instead of streaming a recording"
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
    """The demo with a living building: simulated behind Modbus, in this process, and read by the daemon."""
    from replay.bms.background import living_bms
    from replay.bms.serving import BmsOptions
    from service.cli.show import demo_requests
    from service.daemon.run import run_daemon

    pace = arguments.pace or _DEMO_PACE
    if arguments.days is not None:
        raise ConfigError(["--days is the length of a recording; a --live building has no end, use --duration"])
    if not SMALLEST_PACE <= pace <= LARGEST_PACE:
        raise ConfigError([f"--pace {pace:g}: a --live building lives at {SMALLEST_PACE:g} to {LARGEST_PACE:g}"])
    path = directory / "live.toml"
    changes = [f"http.port={arguments.port}"]
    options = BmsOptions(port=0, control_port=0, zenoh=None, pace=pace, config=path, overrides=changes)
    with living_bms(options) as greeting:
        config = load_config(arguments, path)
        print("\n".join([*greeting[:-1], "", *demo_requests(config)]), flush=True)
        return run_daemon(config, duration=arguments.duration)
