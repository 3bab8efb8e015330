"""`thermogate backup`, `restore` and `inspect`: what is kept of a site, for the person who looks after it."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from service.checkpoint import Checkpoint

AddCommand = Callable[[str, Callable[[argparse.Namespace], int], str], argparse.ArgumentParser]


def add_to(add: AddCommand) -> None:
    """Add the commands by `add(name, command, text)`."""
    backup = add("backup", _backup, "Write journal and checkpoints into one file, while the daemon runs or not.")
    restore = add("restore", _restore, "Put a backup back into the state folder; the daemon must be stopped.")
    for parser in (backup, restore):
        parser.add_argument("config", type=Path, metavar="CONFIG", help="the configuration file (TOML)")
    backup.add_argument("out", type=Path, metavar="OUT", help="the file to write, or a folder to write a new file in")
    restore.add_argument("backup", type=Path, metavar="BACKUP", help="a file that thermogate backup wrote")
    restore.add_argument("--replace", action="store_true", help="set aside the state that is there already")
    inspect = add("inspect", _inspect, "Show what is in a checkpoint; exit code 1 if it is damaged.")
    inspect.add_argument("checkpoint", type=Path, metavar="CHECKPOINT", help="a file of checkpoints/<zone>")


def _backup(arguments: argparse.Namespace) -> int:
    from service.backup import write_backup
    from service.config import load

    site = load(arguments.config, arguments.overrides).site
    made = write_backup(site.state_dir, site.id, arguments.out)
    print(f"{made.path}: site {made.site}, {made.size / 1e6:.1f} MB, zones with a checkpoint: {made.zones}")
    return 0


def _restore(arguments: argparse.Namespace) -> int:
    from service.backup import restore_backup
    from service.config import load

    site = load(arguments.config, arguments.overrides).site
    restored, aside = restore_backup(site.state_dir, site.id, arguments.backup, arguments.replace)
    print(
        f"{site.state_dir}: as it was at {restored.made:%Y-%m-%dT%H:%M:%SZ}, zones with a checkpoint: {restored.zones}"
    )
    if aside is not None:
        print(f"what was there is in {aside}; delete it when you are sure")
    return 0


def _inspect(arguments: argparse.Namespace) -> int:
    from service.checkpoint import DAMAGE, decode
    from service.errors import CheckpointError

    path: Path = arguments.checkpoint
    content = path.read_bytes()
    try:
        lines = description(decode(content, path), path)
    except DAMAGE as error:
        raise CheckpointError(
            f"{path} is damaged ({error}); the daemon sets such a file aside and goes on from the one before it"
        ) from error
    print("\n".join(lines))
    return 0


def description(checkpoint: Checkpoint, path: Path) -> list[str]:
    """What `inspect` prints of `checkpoint`, read from `path`."""
    from service import snapshot
    from service.checkpoint import FORMAT_VERSION
    from service.show import aligned
    from service.store import shown_time

    about: dict[str, Any] = {"network": "?", "estimator": "?", "period": "?", "parameters": [], "thermogate": "?"}
    about |= checkpoint.about
    means = snapshot.parameters(checkpoint)
    named = about["parameters"] or [[f"parameter {number}", "", True] for number in range(1, len(means) + 1)]
    lines = aligned(
        [
            ("zone", path.parent.name),
            ("after the sample at", shown_time(checkpoint.step)),
            ("network", str(about["network"])),
            ("estimator", str(about["estimator"])),
            ("period", f"{about['period']} s"),
            ("fingerprint", checkpoint.fingerprint[:16]),
            ("written by", f"Thermogate {about['thermogate']}, format {FORMAT_VERSION}"),
            ("digest", "right"),
        ]
    )
    rows = [
        (name, f"{mean:.6g}", unit, "" if free else "fixed")
        for (name, unit, free), mean in zip(named, means, strict=True)
    ]
    lines += ["", *aligned([("parameter", "mean", "unit", ""), *rows])]
    arrays = [(name, str(a.dtype), str(a.shape), f"{a.nbytes} B") for name, a in sorted(checkpoint.arrays.items())]
    return [*lines, "", *aligned([("array", "type", "shape", "size"), *arrays])]
