"""`thermogate backup`: what is kept of a site, in one file."""

import argparse
from pathlib import Path

from service.cli.arguments import AddCommand, load_config, take_config


def add_to(add: AddCommand) -> None:
    parser = add(
        "backup",
        _backup,
        "Write journal, checkpoints and the kept configuration into one file, while the daemon runs or not.",
    )
    take_config(parser)
    parser.add_argument("out", type=Path, metavar="OUT", help="the file to write, or a folder to write a new file in")
    parser.add_argument("--sign", type=Path, metavar="FILE", help="sign it with this private key (Ed25519, PEM)")


def _backup(arguments: argparse.Namespace) -> int:
    from service.errors import BackupError
    from service.store.audit import note
    from service.store.backup import write_backup
    from service.store.store import JOURNAL

    config = load_config(arguments)
    site = config.site
    if config.fleet is not None and not (site.state_dir / JOURNAL).exists():
        raise BackupError(
            f"there is no state in {site.state_dir}: a fleet keeps it in the database that fleet.database names; back "
            "that up with the tools of PostgreSQL, such as pg_dump"
        )
    made = write_backup(site.state_dir, site.id, arguments.out, arguments.sign)
    note(site.state_dir, "backup", f"the backup {made.path} is written")
    print(f"{made.path}: site {made.site}, {made.size / 1e6:.1f} MB, zones with a checkpoint: {made.zones}")
    return 0
