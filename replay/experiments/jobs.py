"""A run of an experiment as data, and the fingerprint by which a finished one is known again."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

import estimator
import replay
import service

Arrays = dict[str, npt.NDArray[Any]]


class Job(NamedTuple):
    """One run: `work(payload)` gives named arrays and depends on nothing else.

    `work` is a function of a module, so that another process finds it; `payload` is made of numbers, strings, arrays
    and tuples, mappings or dataclasses of them.
    """

    label: str
    seed: int
    work: Callable[[Any], Arrays]
    payload: Any

    @property
    def name(self) -> str:
        """What the run is called in messages."""
        return f"{self.label}, seed {self.seed}"


def fingerprint(job: Job) -> str:
    """Hexadecimal digest of everything the result of `job` depends on: payload, work and source."""
    digest = hashlib.sha256()
    _feed(digest, (job.work.__module__, job.work.__qualname__, _sources(), job.payload))
    return digest.hexdigest()


@cache
def _sources() -> str:
    """Digest of the source of the packages that a run goes through."""
    digest = hashlib.sha256()
    for package in (estimator, replay, service):
        for path in sorted(Path(package.__file__ or "").parent.rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _feed(digest: Any, value: Any) -> None:
    """Add `value` with its type and shape, so that no two different payloads read the same."""
    if isinstance(value, np.ndarray):
        digest.update(f"array {value.dtype.str} {value.shape};".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Mapping):
        digest.update(f"mapping {len(value)};".encode())
        for key in sorted(value):
            _feed(digest, key)
            _feed(digest, value[key])
    elif is_dataclass(value) and not isinstance(value, type):
        digest.update(f"{type(value).__name__};".encode())
        for field in fields(value):
            _feed(digest, getattr(value, field.name))
    elif isinstance(value, tuple | list):
        digest.update(f"{type(value).__name__} {len(value)};".encode())
        for item in value:
            _feed(digest, item)
    elif value is None or isinstance(value, str | int | float):
        digest.update(f"{type(value).__name__} {value!r};".encode())
    else:
        raise TypeError(f"a payload cannot hold a {type(value).__name__}")
