"""`thermogate fleet`: the zones of a site spread over a Ray cluster."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from service.cli.arguments import AddCommand, load_config, positive, take_config, whole

if TYPE_CHECKING:
    from service.config.site import Config
    from service.fleet.steward import FleetStatus


def add_to(add: AddCommand) -> None:
    """Add the command by `add(name, command, text)`."""
    parser = add("fleet", _chosen, "Run the zones of a site on the machines of a Ray cluster, with a [fleet] table.")
    parser.add_argument(
        "what",
        choices=("run", "status", "rebalance"),
        help="run until SIGTERM or Ctrl-C; show how the fleet is doing; spread the zones over another number of shards",
    )
    take_config(parser)
    parser.add_argument(
        "--address",
        metavar="ADDRESS",
        help='the Ray cluster, such as "10.0.0.1:6379", or "auto" for the one on this machine (default: run starts one '
        "on this machine alone, the others find that)",
    )
    parser.add_argument("--shards", type=whole(1, 4096), metavar="N", help="rebalance: the number of shards")
    parser.add_argument("--json", action="store_true", help="status: as JSON, on one line")
    parser.add_argument("--every", type=positive, metavar="SECONDS", help="status: again and again, until interrupted")


def _chosen(arguments: argparse.Namespace) -> int:
    from service.fleet.checks import fleet_of, require_extra

    config = load_config(arguments)
    fleet_of(config)
    require_extra()
    commands: dict[str, Callable[[argparse.Namespace, Config], int]] = {
        "run": _run,
        "status": _status,
        "rebalance": _rebalance,
    }
    return commands[arguments.what](arguments, config)


def _run(arguments: argparse.Namespace, config: Config) -> int:
    from service.fleet.run import run_fleet

    return run_fleet(config, arguments.address, partial(load_config, arguments))


def _status(arguments: argparse.Namespace, config: Config) -> int:
    from service.fleet.run import ask_steward, watch_steward
    from service.fleet.show import as_json, as_table

    def show(status: FleetStatus) -> None:
        print(json.dumps(as_json(status)) if arguments.json else as_table(status), flush=True)

    if arguments.every is None:
        show(ask_steward(config.site.id, arguments.address, "status"))
    else:
        watch_steward(config.site.id, arguments.address, arguments.every, show)
    return 0


def _rebalance(arguments: argparse.Namespace, config: Config) -> int:
    from service.fleet.checks import fleet_of
    from service.fleet.run import ask_steward

    shards = arguments.shards or fleet_of(config).shards
    print(ask_steward(config.site.id, arguments.address, "rebalance", shards))
    return 0
