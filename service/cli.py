"""The command line: `thermogate COMMAND ...`.

Exit codes: 0 done, 1 failure, 2 usage or configuration, 130 interrupted. Mistakes go to stderr, one sentence a line.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import traceback
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from adapters.errors import SourceError
from estimator.errors import EstimatorError
from replay.errors import ReplayError
from service import cli_bms, cli_experiment, cli_health, cli_keys, cli_probe, cli_state
from service.cli_arguments import instant, positive, whole
from service.errors import ConfigError, ServiceError

if TYPE_CHECKING:
    from service.config import Config

_DESCRIPTION = "Calibrated forecasts, volatility and learning gate for every zone of a building, learned online."
_SET_HELP = (
    "change the configuration for this call: a dotted key and a TOML value, such as http.port=8081 or "
    "zones.living.period=10min (zones by id or index); may be given several times. Relative paths in it are taken "
    "from the folder of the configuration file, like those in the file itself."
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code. `argv` is without the program name; None takes it from the process."""
    try:
        arguments = _parser().parse_args(argv)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    try:
        return _run_command(arguments)
    except KeyboardInterrupt:
        _complain("interrupted")
        return 130


def _run_command(arguments: argparse.Namespace) -> int:
    command: Callable[[argparse.Namespace], int] = arguments.command
    try:
        return command(arguments)
    except ConfigError as error:
        _complain(*error.problems)
        if len(error.problems) > 1:
            _complain(f"{len(error.problems)} mistakes in the configuration; nothing was started")
        return 2
    except (ServiceError, SourceError, EstimatorError, ReplayError) as error:
        _complain(*str(error).splitlines())
    except BrokenPipeError:
        # The reader of our output (head, less) has gone; without this the interpreter complains again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        what = f"{error.filename}: {error.strerror}" if error.filename and error.strerror else str(error)
        _complain(f"{what}; check the path, its permissions and the space left")
        _trace(arguments)
    except Exception as error:
        _complain(
            f"unexpected {type(error).__name__}: {' '.join(str(error).split()) or 'no message'}; this is a fault of "
            "Thermogate, run the command again with --debug and report what it prints"
        )
        _trace(arguments)
    return 1


def _complain(*sentences: str) -> None:
    for sentence in sentences:
        print(f"thermogate: {sentence}", file=sys.stderr)


def _trace(arguments: argparse.Namespace) -> None:
    if arguments.debug:
        traceback.print_exc()


class _Parser(argparse.ArgumentParser):
    """An argument parser that complains the way every command does."""

    def error(self, message: str) -> NoReturn:
        _complain(f"{message}; see {self.prog} --help")
        raise SystemExit(2)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="thermogate", description=_DESCRIPTION, allow_abbrev=False)
    parser.add_argument("--version", action="version", version=f"thermogate {_version()}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    def add(name: str, command: Callable[[argparse.Namespace], int], text: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text, allow_abbrev=False)
        sub.set_defaults(command=command)
        sub.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides", help=_SET_HELP)
        sub.add_argument("--debug", action="store_true", help="show the traceback of an unexpected failure")
        return sub

    def add_with_config(name: str, command: Callable[[argparse.Namespace], int], text: str) -> argparse.ArgumentParser:
        sub = add(name, command, text)
        sub.add_argument("config", type=Path, metavar="CONFIG", help="the configuration file (TOML)")
        return sub

    run = add_with_config("run", _run, "Run the daemon until it is stopped (SIGTERM or Ctrl-C).")
    run.add_argument(
        "--reset", nargs="+", default=[], action="extend", metavar="ZONE", help="forget the stored state of these zones"
    )
    add_with_config("check", _check, "Explain every mistake in a configuration, without connecting to anything.")
    add_with_config("show-config", _show_config, "Print the effective configuration as TOML, every default filled in.")

    cli_probe.add_to(add)
    cli_health.add_to(add)
    cli_state.add_to(add)
    cli_keys.add_to(add)

    demo = add("demo", _demo, "Run the daemon on a simulated two-zone home, streamed faster than real time.")
    demo.add_argument(
        "--directory", type=Path, metavar="DIR", help="keep files and state here (default: a temporary folder)"
    )
    demo.add_argument(
        "--port", type=whole(0, 65535), default=8080, metavar="N", help="HTTP port, 0 for any free one (default 8080)"
    )
    demo.add_argument(
        "--pace", type=positive, metavar="X", help="multiple of real time (default 1800; live 600, at most 3600)"
    )
    demo.add_argument("--days", type=whole(1, 3660), metavar="N", help="length of the simulated period (default 56)")
    demo.add_argument(
        "--live", action="store_true", help="read a simulated building over Modbus instead of streaming a recording"
    )
    demo.add_argument(
        "--duration", type=positive, metavar="SECONDS", help="stop after so many seconds (default: never)"
    )

    cli_bms.add_to(add)

    networks = add("networks", _networks, "List the network presets, or the parameters of one.")
    networks.add_argument(
        "name", nargs="?", metavar="NAME", help="a preset; --set changes it, such as --set solar=true"
    )

    replay = add_with_config(
        "replay", _replay, "Run recorded sources through the zones as fast as possible, into files."
    )
    replay.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    replay.add_argument("--zone", metavar="ID", help="replay this zone only (default: all)")
    replay.add_argument(
        "--seed", type=whole(0, 2**63 - 1), metavar="N", help="seed of every zone (default: the configured ones)"
    )
    replay.add_argument("--start", type=instant, metavar="T", help="first time, RFC 3339, such as 2025-05-03T00:00:00Z")
    replay.add_argument("--end", type=instant, metavar="T", help="time to stop before, RFC 3339")

    cli_experiment.add_to(add)
    return parser


def _version() -> str:
    try:
        return version("thermogate")
    except PackageNotFoundError:
        return "(not installed)"


def _load(path: Path, arguments: argparse.Namespace) -> Config:
    # Here and below: a command imports what it needs when it runs, so that --help does not wait for the compiler.
    from service.config import load

    return load(path, arguments.overrides)


def _require_zones(config: Config, wanted: Sequence[str], option: str) -> None:
    ids = [zone.id for zone in config.zones]
    unknown = [zone for zone in wanted if zone not in ids]
    if unknown:
        raise ConfigError([f'{option}: there is no zone "{zone}"; the zones are {", ".join(ids)}' for zone in unknown])


def _run(arguments: argparse.Namespace) -> int:
    from service.daemon import run_daemon

    config = _load(arguments.config, arguments)
    _require_zones(config, arguments.reset, "--reset")
    return run_daemon(config, reset=arguments.reset, reread=partial(_load, arguments.config, arguments))


def _check(arguments: argparse.Namespace) -> int:
    from service.exposure import check_exposure
    from service.show import summary

    config = _load(arguments.config, arguments)
    check_exposure(config)
    print("\n".join(summary(config)))
    return 0


def _show_config(arguments: argparse.Namespace) -> int:
    from service.show import effective_toml

    print(effective_toml(_load(arguments.config, arguments)), end="")
    return 0


def _demo(arguments: argparse.Namespace) -> int:
    from replay.home import write_demo
    from service.daemon import run_daemon
    from service.show import demo_requests

    kept = arguments.directory
    with nullcontext(kept) if kept else tempfile.TemporaryDirectory(prefix="thermogate-demo-") as directory:
        if arguments.live:
            return cli_bms.live_demo(Path(directory), arguments)
        days, pace = arguments.days or 56, arguments.pace or 1800.0
        config = _load(write_demo(Path(directory), days=days, port=arguments.port, pace=pace), arguments)
        print("\n".join(demo_requests(config)), flush=True)
        return run_daemon(config, duration=arguments.duration)


def _networks(arguments: argparse.Namespace) -> int:
    from service.networks import preset_network
    from service.show import parameter_table, preset_table

    if arguments.name is None:
        if arguments.overrides:
            raise ConfigError(
                ["--set changes one network here; name it, as in: thermogate networks titeth --set solar=true"]
            )
        print("\n".join(preset_table()))
    else:
        print("\n".join(parameter_table(preset_network(arguments.name, arguments.overrides))))
    return 0


def _replay(arguments: argparse.Namespace) -> int:
    from replay.runner import replay_recording

    config = _load(arguments.config, arguments)
    if arguments.zone is not None:
        _require_zones(config, [arguments.zone], "--zone")
    if arguments.start is not None and arguments.end is not None and arguments.start >= arguments.end:
        raise ConfigError(["--start is not before --end; swap or correct them"])
    return replay_recording(
        config,
        arguments.out,
        zone=arguments.zone,
        seed=arguments.seed,
        start=arguments.start,
        end=arguments.end,
        progress=sys.stderr.isatty(),
    )
