"""The command line: `thermogate COMMAND ...`.

Exit codes: 0 done, 1 failure, 2 usage or configuration, 130 interrupted. Mistakes go to stderr, one sentence a line.
"""

import argparse
import atexit
import os
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from importlib.metadata import entry_points, version
from pkgutil import iter_modules
from typing import NoReturn

from adapters.errors import SourceError
from estimator.errors import EstimatorError
from service.cli import commands
from service.cli.arguments import AddCommand
from service.daemon.process import prepare_process
from service.errors import ConfigError, ServiceError, one_line

_DESCRIPTION = (
    "Learns from the telemetry of a building how each room gains and loses heat, and forecasts its temperature up to a "
    "day ahead: with an interval, and whether to trust it. Begin with demo; with a building of your own, with check."
)
_SET_HELP = (
    "change the configuration for this call: a dotted key and a TOML value, such as http.port=8081 or "
    "zones.living.period=10min (zones by id or index); may be given several times. Relative paths in it are taken "
    "from the folder of the configuration file, like those in the file itself."
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; where `argv` is None, the process ends here if a library left a
    thread."""
    prepare_process()
    try:
        code = _run_command(_parser().parse_args(argv))
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0
    except KeyboardInterrupt:
        _complain("interrupted")
        code = 130
    if argv is None and any(thread.daemon for thread in threading.enumerate()):
        # The interpreter would end such a thread inside the library, which aborts the process: an orderly stop of a
        # daemon whose Zenoh session does not close would be a crash.
        atexit._run_exitfuncs()
        with suppress(OSError):
            sys.stdout.flush()
        os._exit(code)
    return code


def _run_command(arguments: argparse.Namespace) -> int:
    command: Callable[[argparse.Namespace], int] = arguments.command
    try:
        return command(arguments)
    except ConfigError as error:
        _complain(*error.problems)
        if len(error.problems) > 1:
            _complain(f"{len(error.problems)} mistakes in the configuration; nothing was started")
        return 2
    except (ServiceError, SourceError, EstimatorError) as error:
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
        print(f"thermogate: {one_line(sentence)}", file=sys.stderr)


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
    parser.add_argument("--version", action="version", version=f"thermogate {version('thermogate')}")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)

    def add(name: str, command: Callable[[argparse.Namespace], int], text: str) -> argparse.ArgumentParser:
        sub = subparsers.add_parser(name, help=text, description=text, allow_abbrev=False)
        sub.set_defaults(command=command)
        sub.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides", help=_SET_HELP)
        sub.add_argument("--debug", action="store_true", help="show the traceback of an unexpected failure")
        return sub

    for add_to in _commands():
        add_to(add)
    return parser


def _commands() -> list[Callable[[AddCommand], None]]:
    """What adds each command: the modules of `service.cli.commands`, and what other packages offer."""
    named = {module.name: f"{commands.__name__}.{module.name}" for module in iter_modules(commands.__path__)}
    found: dict[str, Callable[[AddCommand], None]] = {
        name.replace("_", "-"): import_module(module).add_to for name, module in named.items()
    }
    found |= {offered.name: offered.load() for offered in entry_points(group="thermogate.commands")}
    return [found[name] for name in sorted(found)]
