"""`thermogate learn`: history into the state of a daemon's zones, so that it starts as if it had been running."""

import argparse
import sys
import time
from pathlib import Path

from replay.commands.options import check_period, take_period, take_report
from service.cli.arguments import AddCommand, load_config, require_zones, take_config, take_reset, whole


def add_to(add: AddCommand) -> None:
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
    take_reset(parser)
    take_report(parser)


def _learn(arguments: argparse.Namespace) -> int:
    from adapters.fields.times import written_time
    from replay.recorded.learning import ONE_OF, WHOLE, learn
    from replay.reports.publish import publish_report
    from service.config.load import load_history
    from service.errors import ServiceError
    from service.recordings.history import survey
    from service.store.ownership import refuse_root

    check_period(arguments)
    config = plant = load_config(arguments)
    refuse_root(config.site.state_dir)
    if arguments.history is not None:
        config = load_history(arguments.config, arguments.history, arguments.overrides)
    require_zones(config, arguments.reset, "--reset")
    for warning in config.warnings:
        print(f"warning: {warning}")
    histories = survey(config, config.zones, arguments.start, arguments.end)
    for history in histories.values():
        print("\n  ".join([history.described, *history.doubts]))
    if not any(history.recorded.samples for history in histories.values()):
        raise ServiceError("there is nothing to learn from; look at timestamp, decimal and unit of the sources")
    for name, history in histories.items():
        samples = history.recorded.samples
        if samples and samples[-1].time > time.time():
            # A live zone would refuse every reading until then.
            raise ServiceError(
                f"the history of zone '{name}' goes on until {written_time(samples[-1].time)}, which is still to come; "
                "look at format and zone of timestamp, and at the clock of this machine"
            )
    if any(history.doubts for history in histories.values()):
        print("what is learned from a mistake stays: stop with Ctrl-C, correct it, and learn with --reset ZONE")
    for name, history in histories.items():
        samples = history.recorded.samples
        if samples and samples[-1].time - WHOLE > samples[0].time:
            until = written_time(samples[-1].time - WHOLE)
            print(f"zone '{name}': before {until} one week in {ONE_OF} is learned from, from then on every one")
    learned = learn(config, histories, jobs=arguments.jobs, plant=plant, reset=arguments.reset)
    for zone, known in learned.known.items():
        print(f"zone '{zone}': {known} samples are not later than what it knows already, and were passed over")
    if not learned.traces:
        print("nothing is new; the state is as it was (--reset ZONE lets a zone begin anew)")
        return 0
    return publish_report(config.site.id, learned.traces, arguments.out, sys.stderr.isatty(), arguments.language)
