"""`thermogate run`: the daemon."""

import argparse
from functools import partial

from service.cli.arguments import AddCommand, load_config, require_zones, take_config, take_reset


def add_to(add: AddCommand) -> None:
    parser = add("run", _run, "Run the daemon until it is stopped (SIGTERM or Ctrl-C).")
    take_config(parser)
    take_reset(parser)


def _run(arguments: argparse.Namespace) -> int:
    from service.daemon.run import run_daemon

    config = load_config(arguments)
    require_zones(config, arguments.reset, "--reset")
    return run_daemon(config, reset=arguments.reset, reread=partial(load_config, arguments))
