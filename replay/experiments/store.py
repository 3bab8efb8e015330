"""Finished runs on disk: one file each, written whole or not at all, so that an experiment can be gone on with."""

from __future__ import annotations

import os
import re
import zipfile
import zlib
from pathlib import Path
from tokenize import TokenError

import numpy as np

from replay.experiments.jobs import Arrays, Job, fingerprint


def run_file(folder: Path, job: Job) -> Path:
    """Where the result of `job` belongs; another payload or other code means another file."""
    label = re.sub(r"[^a-z0-9]+", "-", job.label.lower()).strip("-")
    return folder / f"{label}-seed{job.seed}-{fingerprint(job)[:16]}.npz"


def load(path: Path) -> Arrays | None:
    """The arrays of a finished run; None where there is none, or a damaged one that has to be run again."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except FileNotFoundError:
        return None
    # What zipfile, zlib and NumPy make of a file in which some byte is another.
    except (OSError, ValueError, EOFError, RuntimeError, TokenError, zipfile.BadZipFile, zlib.error):
        return None


def save(path: Path, arrays: Arrays) -> None:
    """Write `arrays` beside `path` and rename: an interrupted run leaves no half file under its name."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(f".{os.getpid()}.tmp")
    try:
        with unfinished.open("wb") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
