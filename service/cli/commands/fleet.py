"""`thermogate fleet`: the zones of a site spread over a Ray cluster."""

import argparse
import asyncio
from functools import partial

from service.cli.arguments import AddCommand, load_config, positive, take_config


def add_to(add: AddCommand) -> None:
    parser = add("fleet", _chosen, "Run the zones of a site on the machines of a Ray cluster, with a [fleet] table.")
    parser.add_argument(
        "what", choices=("run", "status"), help="run: until SIGTERM or Ctrl-C; status: show every member"
    )
    take_config(parser)
    parser.add_argument(
        "--address",
        metavar="ADDRESS",
        default="auto",
        help='the Ray cluster, such as "10.0.0.1:6379" (default: the one on this machine)',
    )
    parser.add_argument("--json", action="store_true", help="status: as JSON, on one line")
    parser.add_argument("--every", type=positive, metavar="SECONDS", help="status: repeat it, until interrupted")


def _chosen(arguments: argparse.Namespace) -> int:
    from service.fleet.checks import fleet_of, require_extra

    config = load_config(arguments)
    fleet_of(config)
    require_extra()
    if arguments.what == "run":
        from service.fleet.steward import run_fleet

        return run_fleet(config, arguments.address, partial(load_config, arguments))
    from service.fleet.peers import joined
    from service.fleet.status import show_status

    with joined(arguments.address):
        asyncio.run(show_status(config.site.id, arguments.json, arguments.every))
    return 0
