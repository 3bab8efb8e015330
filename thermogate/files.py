"""A model as one file: NumPy's npz with a digest, never pickle."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from adapters.reading import Fault
from estimator.network.network import Network
from service.config.site import FORMER_ESTIMATOR
from service.errors import CheckpointError, DataError
from service.store.checkpoint import DAMAGE, Checkpoint, decode, encode
from service.store.durable_files import write_file
from service.zone import snapshot
from thermogate.session import Session
from thermogate.settings import Settings, settings_of

_KIND = "thermogate model"
_NETWORK = TypeAdapter(Network)


_UPDATES = "updates"
_TRACE = "trace."


def write_model(path: Path, session: Session, faults: Mapping[Fault, int]) -> None:
    """Write what `read_model` reads; DataError if the file cannot be written."""
    settings = session.settings
    worker = snapshot.take(session.worker, session.mark, settings.zone.estimator)
    assert worker is not None, "a model has learned something before anybody can save it"
    meta = {
        "kind": _KIND,
        "network": asdict(settings.network),
        "settings": {**settings.given, "estimator": settings.zone.estimator},
        "tz": settings.tz,
        "other_columns": settings.other_columns,
        "faults": {str(fault): count for fault, count in faults.items()},
        "worker": worker.meta,
    }
    arrays = {**worker.arrays, _UPDATES: session.updates}
    arrays |= {_TRACE + name: value for name, value in session.tracer.pack().items()}
    content = encode(Checkpoint(session.mark, worker.step, arrays, meta, worker.about))
    temporary = path.parent / f"{path.name}.tmp"
    try:
        write_file(temporary, content)
        temporary.replace(path)
    except OSError as error:
        raise DataError(f"the model cannot be written to {path} ({error.strerror}); choose another file") from None
    finally:
        # It is still there if writing or renaming failed.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def read_model(path: Path) -> tuple[Session, Counter[Fault]]:
    """The session of a saved model and its refused readings; DataError if the file is no such model or damaged."""
    try:
        found = decode(path.read_bytes(), path)
        if found.meta.get("kind") != _KIND:
            raise ValueError("it is a checkpoint of the daemon")
    except FileNotFoundError:
        raise DataError(f"there is no file {path}; give the path that save was given") from None
    except CheckpointError as error:
        raise DataError(str(error)) from None
    except DAMAGE as error:
        raise DataError(f"{path} is no saved model, or it is damaged ({error}); fit the model again") from None
    meta: Mapping[str, Any] = found.meta
    session = Session(_settings(meta))
    if session.mark != found.fingerprint:
        raise DataError(f"{path} was saved by a Thermogate with other defaults; fit the model again")
    snapshot.restore(session.worker, found._replace(meta=meta["worker"]))
    session.updates = found.arrays[_UPDATES]
    # A model saved before there were reports has none.
    if trace := {name.removeprefix(_TRACE): rows for name, rows in found.arrays.items() if name.startswith(_TRACE)}:
        session.tracer.unpack(trace)
    return session, Counter({Fault(name): count for name, count in meta["faults"].items()})


def _settings(meta: Mapping[str, Any]) -> Settings:
    network = _NETWORK.validate_json(json.dumps(meta["network"]))
    # Before the default changed, a model that was told no estimator was saved without one.
    given = {"estimator": FORMER_ESTIMATOR, **meta["settings"]}
    # The network has the sun and the habits that it was saved with, or none.
    if not network.terms:
        given |= {"habits": False, "sun": False}
    settings = settings_of(network, given.pop("columns"), meta["tz"], given)
    return settings._replace(other_columns=tuple(meta["other_columns"]))
