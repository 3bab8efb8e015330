"""`thermogate networks`: the network presets."""

import argparse

from service.cli.arguments import AddCommand
from service.errors import ConfigError


def add_to(add: AddCommand) -> None:
    parser = add("networks", _networks, "List the network presets, or the parameters of one.")
    parser.add_argument("name", nargs="?", metavar="NAME", help="a preset; --set changes it, such as --set solar=true")


def _networks(arguments: argparse.Namespace) -> int:
    from service.cli.show import parameter_table, preset_table
    from service.config.networks import preset_network

    if arguments.name is None:
        if arguments.overrides:
            raise ConfigError(
                ["--set changes one network here; name it, as in: thermogate networks titeth --set solar=true"]
            )
        print("\n".join(preset_table()))
    else:
        print("\n".join(parameter_table(preset_network(arguments.name, arguments.overrides))))
    return 0
