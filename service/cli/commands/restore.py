"""`thermogate restore`: a backup put back."""

import argparse
from pathlib import Path

from service.cli.arguments import AddCommand, load_config, take_config
from service.cli.commands.verify import take_signer


def add_to(add: AddCommand) -> None:
    parser = add("restore", _restore, "Put a backup back into the state folder; the daemon must be stopped.")
    take_config(parser)
    parser.add_argument("backup", type=Path, metavar="BACKUP", help="a file that thermogate backup wrote")
    parser.add_argument("--replace", action="store_true", help="set aside the state that is there already")
    take_signer(parser)


def _restore(arguments: argparse.Namespace) -> int:
    from service.store.audit import note
    from service.store.backup import restore_backup

    site = load_config(arguments).site
    restored, aside = restore_backup(site.state_dir, site.id, arguments.backup, arguments.replace, arguments.signed_by)
    note(site.state_dir, "restored", f"the backup {arguments.backup} of {restored.made:%Y-%m-%dT%H:%M:%SZ} is restored")
    print(
        f"{site.state_dir}: as it was at {restored.made:%Y-%m-%dT%H:%M:%SZ}, zones with a checkpoint: {restored.zones}"
    )
    if aside is not None:
        print(f"what was there is in {aside}; delete it when you are sure")
    return 0
