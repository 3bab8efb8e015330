"""`thermogate learn`: history into the state of a daemon's zones, so that it starts as if it had been running."""

import argparse
import sys
from pathlib import Path

from replay.commands.options import check_period, take_period, take_report
from service.cli.arguments import AddCommand, load_config, take_config, whole


def add_to(add: AddCommand) -> None:
    """Add the command by `add(name, command, text)`."""
    parser = add(
        "learn",
        _learn,
        "Take recorded history into the state of the configured zones, so that the daemon starts as if it had been "
        "running. After Ctrl-C, the same command continues.",
    )
    take_config(parser)
    parser.add_argument(
        "--from",
        dest="history",
        type=Path,
        metavar="FILE",
        help="a file with [sources] that are recorded, and [[zones]] with id and channels, or a Parquet file "
        "(default: the sources of CONFIG, which then must be recorded)",
    )
    take_period(parser)
    parser.add_argument("--jobs", type=whole(1, 1024), metavar="N", help="processes (default: one for each core)")
    take_report(parser)


def _learn(arguments: argparse.Namespace) -> int:
    from replay.recorded.learning import learn
    from replay.reports.publish import publish_report
    from service.config.load import load_history
    from service.errors import ServiceError
    from service.recordings.history import survey

    check_period(arguments)
    if arguments.history is None:
        config = load_config(arguments)
    else:
        config = load_history(arguments.config, arguments.history, arguments.overrides)
    histories = survey(config, config.zones, arguments.start, arguments.end)
    for history in histories.values():
        print("\n  ".join([history.described, *history.doubts]))
    if not any(history.recorded.samples for history in histories.values()):
        raise ServiceError("there is nothing to learn from; look at timestamp, decimal and unit of the sources")
    learned = learn(config, histories, jobs=arguments.jobs)
    for zone, known in learned.known.items():
        print(f"zone '{zone}': {known} samples are not later than what it knows already, and were passed over")
    if not learned.traces:
        print("nothing is new; the state is as it was")
        return 0
    return publish_report(config.site.id, learned.traces, arguments.out, sys.stderr.isatty(), arguments.language)
