"""A zone worker as named arrays and JSON, for its checkpoint, and back with the same bits: the estimator's arrays and
the held inputs as they are, the rest of the worker as JSON, in which a float reads back as the same float."""

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from functools import partial
from importlib.metadata import version
from itertools import count
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, ConfigDict, PlainSerializer, TypeAdapter
from pydantic.dataclasses import dataclass

from adapters.reading import Quality
from estimator.arrays import together, under
from estimator.diagnosis.finding import Diagnosis
from estimator.diagnosis.record import Record
from estimator.diagnosis.telemetry.earlier import Earlier
from estimator.diagnosis.telemetry.lies import Suspicion
from estimator.diagnosis.telemetry.recent import Recent
from estimator.foresight import restored
from estimator.loop import Held, Loop
from estimator.loop import Standing as LoopStanding
from estimator.neighbours import Experience
from estimator.network.network import Network
from estimator.thermostat import thermostat as thermostats
from service.records.stored import named, stored
from service.records.trust import Trust
from service.records.update import CONSTANT, Update
from service.store.checkpoint import BEGINNING, Checkpoint
from service.zone.worker import Progress, Standing, ZoneWorker, stated

_ESTIMATOR, _VERIFIED, _ISSUED, _HELD = "estimator.", "verified.", "issued.", "held_"
_DAY, _RECENT, _RECORD, _THERMOSTAT, _LIVE, _BEGAN = "day.", "recent.", "record.", "thermostat.", "live.", "began."
_EARLIER, _TIME, _STATE = "earlier{}.", "time", "state."

_VERSION = version("thermogate")


@dataclass(config=ConfigDict(ser_json_inf_nan="constants"))
class _Meta:
    """The part of a worker that is not arrays."""

    held_qualities: tuple[Quality, ...]
    progress: Progress
    latest: Annotated[Update, BeforeValidator(partial(named, Update)), PlainSerializer(stored)]
    diagnosis: Annotated[Diagnosis, BeforeValidator(partial(named, Diagnosis)), PlainSerializer(stored)] = Diagnosis()
    trust: Annotated[Trust, BeforeValidator(partial(named, Trust)), PlainSerializer(stored)] = Trust()
    suspicions: tuple[Suspicion, ...] = ()


_META = TypeAdapter(_Meta)


def fingerprint(network: Network, period: float, estimator: str, structure: Mapping[str, object]) -> str:
    """The SHA-256 of what a stored state belongs to: network, period, estimator and its structural options, without
    names, descriptions, starting rules and the bounds of fixed parameters."""
    described = {
        "nodes": dict(network.capacitances),
        "boundaries": list(network.boundaries),
        "conductances": [asdict(edge) for edge in network.conductances],
        "heat_inputs": [asdict(heat) for heat in network.heat_inputs],
        "measured": list(network.measured),
        "parameters": [(p.name, p.lower, p.upper) if p.free else (p.name, p.nominal) for p in network.parameters],
        **({"terms": [(term.name, term.node, term.series) for term in network.terms]} if network.terms else {}),
        "period": float(period),
        "estimator": estimator,
        "options": dict(structure),
    }
    return hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()


def take(worker: ZoneWorker, mark: str, estimator: str) -> Checkpoint | None:
    """The checkpoint of a worker whose fingerprint is `mark`, and `estimator` the name of its own; None before its
    first update."""
    # The inputs that are held go on while the zone stalls, and nothing else does.
    carried, standing = worker.carried, worker.standing
    if standing is None or carried.standing is None or carried.standing.verified is None:
        return None
    loop, update = worker.loop, standing.update
    parts: dict[str, Mapping[str, Any]] = {
        _ESTIMATOR: loop.estimator.pack(standing.state),
        _VERIFIED: loop.verification.pack(carried.standing.verified),
        _ISSUED: loop.as_issued.pack(carried.standing.issued),
        _HELD: carried.held._asdict(),
        _DAY: carried.day._asdict(),
        _RECENT: carried.recent._asdict(),
        _RECORD: carried.record._asdict(),
        _THERMOSTAT: thermostats.pack(carried.thermostat),
        _LIVE: loop.live.pack(carried.live),
        _BEGAN: carried.experience or {},
    }
    for place, earlier in enumerate(carried.earlier):
        part = _EARLIER.format(place)
        parts[part] = {_TIME: np.array(earlier.time, dtype=np.float64)}
        parts[part + _STATE] = loop.estimator.pack(earlier.state)
        parts[part + _LIVE] = loop.live.pack(earlier.live)
    shown = update._replace(gate=update.shown_gate, effective_sample_size=update.shown_sample_size)
    meta = _META.dump_python(
        _Meta(worker.input_quality, worker.progress, shown, carried.diagnosis, worker.trust, carried.suspicions),
        mode="json",
    )
    return Checkpoint(mark, int(worker.progress.last_time or 0), together(parts), meta, _about(worker, estimator))


def beginning(worker: ZoneWorker, mark: str, estimator: str, experience: Experience) -> Checkpoint:
    """The checkpoint, before every sample, of a fresh `worker` that begins with `experience`."""
    return Checkpoint(mark, BEGINNING, together({_BEGAN: experience}), {}, _about(worker, estimator))


def _about(worker: ZoneWorker, estimator: str) -> dict[str, object]:
    return {
        "network": worker.network.name,
        "estimator": estimator,
        "period": worker.period,
        "parameters": [[p.name, p.unit, p.free] for p in worker.network.parameters],
        "thermogate": _VERSION,
    }


def parameters(checkpoint: Checkpoint) -> tuple[float, ...]:
    """The posterior means of the parameters in a checkpoint, in the network's order and each in its own unit; none
    before every sample."""
    if checkpoint.is_beginning:
        return ()
    return _META.validate_python(checkpoint.meta).latest.parameters


def restore(worker: ZoneWorker, checkpoint: Checkpoint) -> None:
    """Put a fresh `worker` where the checkpoint was taken."""
    begin(worker, checkpoint)
    if checkpoint.is_beginning:
        return
    meta, loop, arrays = _META.validate_python(checkpoint.meta), worker.loop, checkpoint.arrays
    update = meta.latest
    if update.gate is not None and update.gate.regime == CONSTANT:
        update = update._replace(gate=None)
    if update.effective_sample_size is not None and math.isnan(update.effective_sample_size):
        update = update._replace(effective_sample_size=None)
    carried = worker.carried._replace(
        held=Held(**under(_HELD, arrays)),
        day=restored(under(_DAY, arrays)),
        record=Record(**under(_RECORD, arrays)),
        live=loop.live.unpack(under(_LIVE, arrays)),
        suspicions=meta.suspicions,
        earlier=tuple(_earlier(loop, arrays)),
        diagnosis=meta.diagnosis,
        vanished=meta.progress.vanished,
        standing=LoopStanding(
            loop.estimator.unpack(under(_ESTIMATOR, arrays)),
            stated(update.forecast),
            loop.verification.unpack(under(_VERIFIED, arrays)),
            loop.as_issued.unpack(under(_ISSUED, arrays)),
        ),
    )
    # State of before the telemetry was watched has none.
    if recent := under(_RECENT, arrays):
        carried = carried._replace(recent=Recent(**recent))
    # A zone that was told no set-point once stored nothing of these.
    if known := under(_THERMOSTAT, arrays):
        carried = carried._replace(thermostat=thermostats.unpack(known, len(worker.network.inputs)))
    worker.resume(Standing(carried, update), meta.held_qualities, meta.progress, meta.trust)


def begin(worker: ZoneWorker, checkpoint: Checkpoint) -> None:
    """Let a fresh `worker` begin with what the zone of the checkpoint began with."""
    worker.carried = worker.carried._replace(experience=under(_BEGAN, checkpoint.arrays) or None)


def _earlier(loop: Loop, arrays: Mapping[str, Any]) -> Iterator[Earlier]:
    for part in map(_EARLIER.format, count()):
        if not (state := under(part + _STATE, arrays)):
            return
        live = loop.live.unpack(under(part + _LIVE, arrays))
        yield Earlier(float(arrays[part + _TIME]), loop.estimator.unpack(state), live)
