"""`thermogate verify`: whether a state folder or a backup is whole."""

import argparse
import sys
from pathlib import Path

from service.cli.arguments import AddCommand


def add_to(add: AddCommand) -> None:
    parser = add(
        "verify", _verify, "Check every file of a state folder or a backup; exit code 1 if anything is damaged."
    )
    parser.add_argument("path", type=Path, metavar="PATH", help="the folder that site.state_dir names, or a backup")
    take_signer(parser)


def take_signer(parser: argparse.ArgumentParser) -> None:
    """The option for the public key that a backup must be signed with."""
    parser.add_argument(
        "--signed-by", type=Path, metavar="FILE", help="refuse a backup that this public key (PEM) has not signed"
    )


def _verify(arguments: argparse.Namespace) -> int:
    from service.store.verifying import verify

    found = verify(arguments.path, arguments.signed_by)
    for problem in found.problems:
        print(problem, file=sys.stderr)
    verdict = "damaged" if found.problems else "sound"
    print(
        f"{arguments.path}: {verdict}; zones: {found.zones}, samples: {found.samples}, rows of history: {found.rows}, "
        f"checkpoints: {found.checkpoints}, lines of the audit trail: {found.audited}"
    )
    return 1 if found.problems else 0
