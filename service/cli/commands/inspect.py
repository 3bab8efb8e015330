"""`thermogate inspect`: what is in a checkpoint."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.cli.arguments import AddCommand

if TYPE_CHECKING:
    from service.store.checkpoint import Checkpoint


def add_to(add: AddCommand) -> None:
    parser = add("inspect", _inspect, "Show what is in a checkpoint; exit code 1 if it is damaged.")
    parser.add_argument("checkpoint", type=Path, metavar="CHECKPOINT", help="a file of checkpoints/<zone>")


def _inspect(arguments: argparse.Namespace) -> int:
    from service.errors import CheckpointError
    from service.store.checkpoint import DAMAGE, decode

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
    from adapters.fields.times import written_time
    from service.cli.tables import aligned
    from service.store.checkpoint import FORMAT_VERSION
    from service.zone import snapshot

    about: dict[str, Any] = {"network": "?", "estimator": "?", "period": "?", "parameters": [], "thermogate": "?"}
    about |= checkpoint.about
    means = snapshot.parameters(checkpoint)
    # What a zone begins with, before every sample, has no means.
    named = about["parameters"][: len(means)] or [
        [f"parameter {number}", "", True] for number in range(1, len(means) + 1)
    ]
    lines = aligned(
        [
            # Earlier versions did not write whose it is.
            ("zone", checkpoint.zone or path.absolute().parent.name),
            (
                "after the sample at",
                "none: its beginning" if checkpoint.is_beginning else written_time(checkpoint.step),
            ),
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
