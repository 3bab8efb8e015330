"""`thermogate check`: every mistake in a configuration, explained."""

from __future__ import annotations

import argparse

from service.cli.arguments import AddCommand, load_config, take_config


def add_to(add: AddCommand) -> None:
    """Add the command by `add(name, command, text)`."""
    take_config(add("check", _check, "Explain every mistake in a configuration, without connecting to anything."))


def _check(arguments: argparse.Namespace) -> int:
    from service.cli.show import summary
    from service.daemon.exposure import check_exposure

    config = load_config(arguments)
    check_exposure(config)
    print("\n".join([*summary(config), *(f"warning: {warning}" for warning in config.warnings)]))
    return 0
