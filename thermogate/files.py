"""A model as one file, NumPy's npz with a digest and never pickle, or out of the state folder of a daemon."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from adapters.channel import ChannelConfig
from adapters.fields.words import shown
from adapters.reading import Fault
from estimator.arrays import together, under
from estimator.network.network import Network
from service.config.fitting import fingerprint
from service.config.kept import kept_configuration
from service.config.load import load
from service.config.site import FORMER_ESTIMATOR, SiteConfig, ZoneConfig
from service.errors import CheckpointError, DataError
from service.records.outlook import SET_POINTS
from service.store.checkpoint import DAMAGE, Checkpoint, decode, encode
from service.store.durable_files import replace_file
from service.store.reading import read_state
from service.zone import snapshot
from thermogate.session import Session
from thermogate.settings import PLACE, Settings, settings_of

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
        "network": asdict(settings.zone.network),
        "settings": {**settings.given, "estimator": settings.zone.estimator},
        "tz": settings.tz,
        "other_columns": settings.other_columns,
        "faults": {str(fault): count for fault, count in faults.items()},
        "worker": worker.meta,
    }
    arrays = {**worker.arrays, _UPDATES: session.updates} | together({_TRACE: session.tracer.pack()})
    content = encode(Checkpoint(session.mark, worker.step, arrays, meta, worker.about))
    try:
        replace_file(path, content)
    except OSError as error:
        raise DataError(f"the model cannot be written to {path} ({error.strerror}); choose another file") from None


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
    if trace := under(_TRACE, found.arrays):
        session.tracer.unpack(trace)
    return session, Counter({Fault(name): count for name, count in meta["faults"].items()})


def read_zone(folder: Path, name: str | None) -> tuple[Session, Counter[Fault]]:
    """The session of the zone `name` of the daemon whose state is in `folder`, which is left as it is; by default the
    only one. It goes on from the newest checkpoint, with the samples after it; ServiceError where that cannot be read.
    """
    config = load(kept_configuration(folder))
    zones = {zone.id: zone for zone in config.zones}
    zone = next(iter(zones.values())) if name is None and len(zones) == 1 else zones.get(str(name))
    if zone is None:
        wrong = "it has several zones" if name is None else f"it has no zone {shown(name)}"
        raise DataError(f'{folder}: {wrong}; choose one of {", ".join(zones)}, such as zone="{next(iter(zones))}"')
    session = Session(_as_in_a_notebook(zone, config.site))
    mark = fingerprint(zone)
    with read_state(folder) as state:
        checkpoint = state.checkpoint(zone.id, mark)
        if checkpoint is None or checkpoint.is_beginning or session.mark != mark:
            raise DataError(
                f"{folder} has no checkpoint of zone {shown(zone.id)} as it is configured; let the daemon run for a "
                "while, or thermogate learn"
            )
        snapshot.restore(session.worker, checkpoint)
        samples = list(state.journal.samples_after(zone.id, None))
        rows = {row.time: row for row in state.journal.history(zone.id, None, None, _MOST_ROWS)}
    held = np.full(len(zone.network.inputs), np.nan)
    for sample in samples:
        held = np.where(np.isnan(sample.inputs), held, sample.inputs)
        if sample.time > checkpoint.step:
            session.take(sample)
        elif sample.time in rows:
            session.tracer.remember(rows[sample.time], held)
    return session, Counter()


def _as_in_a_notebook(zone: ZoneConfig, site: SiteConfig) -> Settings:
    """The settings of a zone of a daemon, whose tables have columns called as its channels, in the network's units."""
    columns = {name: {"column": name, **_limits(channel)} for name, channel in zone.channels.items()}
    if zone.setpoint is not None:
        columns[SET_POINTS] = {"column": SET_POINTS, **_limits(zone.setpoint)}
    given = {name: getattr(zone, name) for name in _OF_ZONE if getattr(zone, name) is not None}
    given |= {name: getattr(site, name) for name in PLACE if getattr(site, name) is not None}
    return settings_of(zone.network, columns, site.time_zone or "UTC", given, stored=True)


def _limits(channel: ChannelConfig) -> dict[str, object]:
    """What is believed, held and planned of a channel, of the power of a valve as much as it has at 100 %."""
    limits = {"max_age": channel.max_age, "valid": channel.valid, "installed": channel.installed or channel.nominal}
    return {name: value for name, value in limits.items() if value is not None}


_OF_ZONE = ("period", "estimator", "estimator_options", "seed", "levels", "max_gap", "hold_inputs", "floor_area")
_MOST_ROWS = 2**31


def _settings(meta: Mapping[str, Any]) -> Settings:
    network = _NETWORK.validate_json(json.dumps(meta["network"]))
    # Before the default changed, a model that was told no estimator was saved without one.
    given = {"estimator": FORMER_ESTIMATOR, **meta["settings"]}
    settings = settings_of(network, given.pop("columns"), meta["tz"], given, stored=True)
    return settings._replace(other_columns=tuple(meta["other_columns"]))
