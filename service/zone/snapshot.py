"""A zone worker as named arrays and JSON, for its checkpoint, and back.

What comes back continues bit for bit: the estimator's arrays and the held inputs are stored as they are, the rest of
the worker (counters, the latest update) as JSON, in which a float reads back as the same float.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np
from pydantic import ConfigDict, TypeAdapter
from pydantic.dataclasses import dataclass

from adapters.reading import Quality
from estimator.diagnosis.finding import Diagnosis
from estimator.diagnosis.record import Record
from estimator.network.network import Network
from service.records.trust import Trust
from service.records.update import CONSTANT, Update
from service.store.checkpoint import Checkpoint
from service.zone.foresight.yesterday import Day, no_day
from service.zone.worker import Held, Known, Progress, Standing, ZoneWorker

_HELD_VALUES = "held_values"
_HELD_TIMES = "held_times"
_ESTIMATOR = "estimator."
_VERIFIED = "verified."
_RECORD = "record."
_DAY = "day."

_VERSION = version("thermogate")


@dataclass(config=ConfigDict(ser_json_inf_nan="constants"))
class _Meta:
    """The part of a worker that is not arrays."""

    held_qualities: tuple[Quality, ...]
    progress: Progress
    latest: Update
    diagnosis: Diagnosis = Diagnosis()
    trust: Trust = Trust()


_META = TypeAdapter(_Meta)


def fingerprint(network: Network, period: float, estimator: str, structure: Mapping[str, object]) -> str:
    """What a stored state belongs to: network, period, estimator and its structural options, as a SHA-256.

    Names and descriptions, starting rules and the bounds of fixed parameters may change without making it another one.
    """
    described = {
        "nodes": dict(network.capacitances),
        "boundaries": list(network.boundaries),
        "conductances": [asdict(edge) for edge in network.conductances],
        "heat_inputs": [asdict(heat) for heat in network.heat_inputs],
        "measured": list(network.measured),
        "parameters": [(p.name, p.lower, p.upper) if p.free else (p.name, p.nominal) for p in network.parameters],
        "period": float(period),
        "estimator": estimator,
        "options": dict(structure),
    }
    return hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()


def take(worker: ZoneWorker, mark: str, estimator: str) -> Checkpoint | None:
    """The checkpoint of a worker whose fingerprint is `mark`; None before its first update.

    `estimator` is its name in the registry.
    """
    held, progress, standing = worker.held, worker.progress, worker.standing
    if standing is None:
        return None
    arrays = {_ESTIMATOR + name: np.asarray(value) for name, value in worker.estimator.pack(standing.state).items()}
    arrays |= {_VERIFIED + name: value for name, value in worker.verification.pack(standing.verified).items()}
    arrays |= {_HELD_VALUES: held.values, _HELD_TIMES: held.times}
    update = standing.update
    stated = update._replace(gate=update.shown_gate, effective_sample_size=update.shown_sample_size)
    known = worker.known
    meta = _META.dump_python(_Meta(held.qualities, progress, stated, known.diagnosis, known.trust), mode="json")
    arrays |= {_DAY + name: value for name, value in standing.day._asdict().items()}
    arrays |= {_RECORD + name: value for name, value in known.record._asdict().items()}
    about = {
        "network": worker.network.name,
        "estimator": estimator,
        "period": worker.period,
        "parameters": [[p.name, p.unit, p.free] for p in worker.network.parameters],
        "thermogate": _VERSION,
    }
    return Checkpoint(mark, int(progress.last_time or 0), arrays, meta, about)


def parameters(checkpoint: Checkpoint) -> tuple[float, ...]:
    """The posterior means of the parameters in a checkpoint, in the network's order and each in its own unit."""
    return _META.validate_python(checkpoint.meta).latest.parameters


def restore(worker: ZoneWorker, checkpoint: Checkpoint) -> None:
    """Put a fresh `worker` where the checkpoint was taken."""
    meta = _META.validate_python(checkpoint.meta)
    update = meta.latest
    if update.gate is not None and update.gate.regime == CONSTANT:
        update = update._replace(gate=None)
    if update.effective_sample_size is not None and math.isnan(update.effective_sample_size):
        update = update._replace(effective_sample_size=None)
    held = Held(checkpoint.arrays[_HELD_VALUES], checkpoint.arrays[_HELD_TIMES], meta.held_qualities)
    state = worker.estimator.unpack(_under(_ESTIMATOR, checkpoint))
    stored = _under(_VERIFIED, checkpoint)
    # Before version 0.2 no forecast was verified: what is pending then begins with this start.
    outputs = np.array(update.y)
    verified = (
        worker.verification.unpack(stored)
        if stored
        else worker.verification.start(worker.settings.seed, outputs, held.values)
    )
    standing = Standing(state, update, verified, _day(worker, checkpoint))
    worker.resume(standing, held, meta.progress, _known(worker, checkpoint, meta))


def _under(prefix: str, checkpoint: Checkpoint) -> dict[str, Any]:
    return {name.removeprefix(prefix): value for name, value in checkpoint.arrays.items() if name.startswith(prefix)}


def _known(worker: ZoneWorker, checkpoint: Checkpoint, meta: _Meta) -> Known | None:
    """What was known; None in a checkpoint from before there was a record, or with a record of another length."""
    stored = _alike(worker.known.record._asdict(), _RECORD, checkpoint)
    return None if stored is None else Known(Record(**stored), meta.diagnosis, meta.trust)


def _day(worker: ZoneWorker, checkpoint: Checkpoint) -> Day:
    """The last day; an empty one in a checkpoint from before it was kept."""
    fresh = no_day(len(worker.network.inputs), worker.period)
    stored = _alike(fresh._asdict(), _DAY, checkpoint)
    return fresh if stored is None else Day(**stored)


def _alike(fresh: Mapping[str, Any], prefix: str, checkpoint: Checkpoint) -> dict[str, Any] | None:
    """The arrays of `checkpoint` under `prefix` with the names and shapes of `fresh`; None where they are others."""
    stored = {name: checkpoint.arrays.get(prefix + name) for name in fresh}
    if any(value is None or value.shape != fresh[name].shape for name, value in stored.items()):
        return None
    return stored
