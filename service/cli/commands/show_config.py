"""`thermogate show-config`: the effective configuration."""

import argparse

from service.cli.arguments import AddCommand, load_config, take_config


def add_to(add: AddCommand) -> None:
    take_config(add("show-config", _show, "Print the effective configuration as TOML, every default filled in."))


def _show(arguments: argparse.Namespace) -> int:
    from service.config.written import effective_toml

    print(effective_toml(load_config(arguments)), end="")
    return 0
