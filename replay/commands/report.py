"""`thermogate report`: the report of a running daemon's history."""

import argparse
import sys
from pathlib import Path

from replay.commands.options import take_report
from service.cli.arguments import AddCommand, load_config, require_zones, whole


def add_to(add: AddCommand) -> None:
    parser = add("report", _report, "Make the report of a daemon's history, while it runs or not.")
    parser.add_argument(
        "state_dir", type=Path, nargs="?", metavar="STATE_DIR", help="the folder that site.state_dir names"
    )
    parser.add_argument(
        "--fleet",
        action="store_true",
        help="of a fleet: read the database that [fleet] of --config names, and no folder",
    )
    parser.add_argument("--zone", metavar="ID", help="this zone only (default: all)")
    parser.add_argument("--days", type=whole(1, 3660), metavar="N", help="the last N days only (default: all)")
    parser.add_argument(
        "--config",
        type=Path,
        metavar="CONFIG",
        help="the configuration of the daemon (default: the one that it keeps in STATE_DIR)",
    )
    take_report(parser)


def _report(arguments: argparse.Namespace) -> int:
    from replay.recorded.stored import stored_traces, traces_of
    from replay.reports.publish import publish_report
    from service.config.kept import kept_configuration
    from service.errors import ServiceError

    if arguments.fleet == (arguments.state_dir is not None):
        raise ServiceError("name either STATE_DIR, the folder of a daemon, or --fleet with --config")
    if arguments.fleet and arguments.config is None:
        raise ServiceError("--fleet needs --config: a fleet keeps its configuration in no folder")
    config = load_config(arguments, arguments.config or kept_configuration(arguments.state_dir))
    if arguments.zone is not None:
        require_zones(config, [arguments.zone], "--zone")
    zones = [zone for zone in config.zones if arguments.zone in (None, zone.id)]
    watched = sys.stderr.isatty()
    if arguments.fleet:
        from service.fleet.checks import connection_of, fleet_of
        from service.store.postgres.reading import read_site

        with read_site(connection_of(fleet_of(config)), config.site.id) as state:
            traces = traces_of(state, "the database of the fleet", zones, arguments.days, watched)
    else:
        traces = stored_traces(arguments.state_dir, zones, arguments.days, watched)
    return publish_report(config.site.id, traces, arguments.out, watched, arguments.language)
