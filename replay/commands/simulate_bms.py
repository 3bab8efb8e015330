"""`thermogate simulate-bms`: its arguments, and what they start."""

import argparse
from dataclasses import fields
from pathlib import Path

from replay.commands.options import Option, add_options
from service.cli.arguments import AddCommand, number, whole

_MOST_ZONES = 80
SMALLEST_PACE, LARGEST_PACE = 0.01, 3600.0


def add_to(add: AddCommand) -> None:
    parser = add("simulate-bms", _simulate_bms, "Simulate a building behind Modbus, Zenoh and BACnet servers.")
    options: dict[str, Option] = {
        "--zones": (whole(1, _MOST_ZONES), "4", "N", "number of rooms"),
        "--port": (whole(0, 65535), "5020", "N", "Modbus port, 0 for any free one"),
        "--control-port": (whole(0, 65535), "5021", "N", "HTTP port of the control surface, 0 for any free one"),
        "--zenoh": (
            _endpoint,
            "tcp/127.0.0.1:7448",
            "ENDPOINT",
            'endpoint that Zenoh listens on, "off" for none',
        ),
        "--bacnet": (
            _bacnet,
            "off",
            "PORT",
            'UDP port of the BACnet/IP devices (such as 47808), 0 for any free one, "off" for none',
        ),
        "--pace": (number(SMALLEST_PACE, LARGEST_PACE), "60", "X", "simulated seconds per second, at most 3600"),
        "--seed": (whole(0, 2**63 - 1), "1", "N", "seed of building, weather and people"),
    }
    add_options(parser, options)
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="SPEC",
        dest="faults",
        help="KIND[:DEVICE[/CHANNEL]][,value=V][,after=D][,for=D], such as drift:room1/T_air,value=0.5,after=10min; "
        "may be given several times",
    )
    parser.add_argument(
        "--write-config",
        type=Path,
        dest="config",
        metavar="PATH",
        help="write the configuration that reads this building",
    )


def _simulate_bms(arguments: argparse.Namespace) -> int:
    from replay.bms.faults import parse_spec
    from replay.bms.serving import BmsOptions, simulate_bms
    from service.errors import ConfigError

    if arguments.overrides and arguments.config is None:
        raise ConfigError(["--set changes the configuration that --write-config writes; give that too"])
    given = {name: value for name, value in vars(arguments).items() if name in {one.name for one in fields(BmsOptions)}}
    return simulate_bms(BmsOptions(**given | {"faults": [parse_spec(text) for text in arguments.faults]}))


def _bacnet(text: str) -> int | None:
    return None if text == "off" else whole(0, 65535)(text)


def _endpoint(text: str) -> str | None:
    from adapters.fields.values import loopback_endpoint

    if text == "off":
        return None
    try:
        return loopback_endpoint(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
