"""`thermogate replay`: recorded sources through the daemon's own worker, into files."""

import argparse
import sys
from contextlib import suppress
from pathlib import Path

from replay.commands.options import check_period, take_period, take_report
from service.cli.arguments import AddCommand, load_config, require_zones, take_config, whole


def add_to(add: AddCommand) -> None:
    parser = add(
        "replay", _replay, "Run recorded sources through the zones as fast as possible, into files and a page."
    )
    take_config(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    parser.add_argument("--zone", metavar="ID", help="replay this zone only (default: all)")
    parser.add_argument(
        "--seed", type=whole(0, 2**63 - 1), metavar="N", help="seed of every zone (default: the configured ones)"
    )
    take_period(parser)
    take_report(parser, out=False)


def _replay(arguments: argparse.Namespace) -> int:
    from replay.recorded.runner import replay_recording
    from replay.reports.publish import FILE, publish_report

    config = load_config(arguments)
    if arguments.zone is not None:
        require_zones(config, [arguments.zone], "--zone")
    check_period(arguments)
    # The page of an earlier replay must not stand beside the rows of one that fails.
    with suppress(OSError):
        (arguments.out / FILE).unlink()
    traces = replay_recording(
        config,
        arguments.out,
        zone=arguments.zone,
        seed=arguments.seed,
        start=arguments.start,
        end=arguments.end,
        progress=sys.stderr.isatty(),
    )
    return publish_report(config.site.id, traces, arguments.out, sys.stderr.isatty(), arguments.language)
