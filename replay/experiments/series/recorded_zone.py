"""A zone's recording, or its live history, on its grid: cut where nothing bridges a gap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.network.network import Network
from replay.errors import ReplayError
from replay.experiments.series.filtering import Series
from replay.localtime import DAY, Seconds
from replay.recorded.stored import stored_samples
from replay.scores.windows import Window, unbroken_runs
from service.config.site import Config, ZoneConfig
from service.recordings.samples import read_samples
from service.records.outlook import SET_POINTS
from service.records.sample import Sample


class ZoneRecord(NamedTuple):
    """Samples of a zone: UTC s (K,), ascending multiples of `period` s, and by channel its values (K,), NaN where the
    interval had no usable reading and no input was held. Set-points, where anybody says, are the column SET_POINTS."""

    times: Seconds
    period: int
    columns: Mapping[str, Array]

    def matrix(self, channels: Sequence[str]) -> Array:
        """(K, len(channels))."""
        return np.column_stack([self.columns[channel] for channel in channels])

    def first_days(self, days: int | None) -> ZoneRecord:
        """The first `days` of it; None: all."""
        if days is None:
            return self
        return self.rows(Window(0, int(np.searchsorted(self.times, self.times[0] + days * DAY))))

    def rows(self, window: Window) -> ZoneRecord:
        begin, end = window
        columns = {channel: values[begin:end] for channel, values in self.columns.items()}
        return ZoneRecord(self.times[begin:end], self.period, columns)


def read_zone(config: Config, table: ZoneConfig) -> ZoneRecord:
    """The recording of the zone `table` of `config`; ServiceError or ReplayError where it cannot be read."""
    samples = read_samples(config, [table])[table.id].samples
    if not samples:
        raise ReplayError(
            f"zone '{table.id}': no usable sample in the recording; look at timestamp, column and unit in the "
            "configuration"
        )
    return record_of(samples, table)


def live_zone(state_dir: Path, table: ZoneConfig) -> ZoneRecord:
    """The samples that a daemon on `state_dir` has accepted for the zone `table`, also while it runs.

    ServiceError or ReplayError where they cannot be read.
    """
    samples = stored_samples(state_dir, table)
    if not samples:
        raise ReplayError(f"zone '{table.id}': the daemon on {state_dir} has no sample of it; give it telemetry first")
    return record_of(samples, table)


def record_of(samples: Sequence[Sample], table: ZoneConfig) -> ZoneRecord:
    """The record that `samples` of the zone `table`, at least one, make up."""
    network = table.network
    times = np.array([sample.time for sample in samples], dtype=np.int64)
    outputs = np.array([sample.outputs for sample in samples])
    inputs = []
    for channel, values in zip(network.inputs, np.array([sample.inputs for sample in samples]).T, strict=True):
        # A value is measured when its interval ends, and is as old when that of the sample that uses it does.
        age = table.channels[channel].max_age
        inputs.append(held(times, values, table.hold_inputs if age is None else age))
    values = np.column_stack([outputs, *inputs])
    columns = dict(zip(network.channels, values.T, strict=True))
    if table.setpoint is not None:
        columns.setdefault(SET_POINTS, np.array([sample.setpoint for sample in samples]))
    return ZoneRecord(times, int(table.period), columns)


def bridged(record: ZoneRecord, network: Network, max_gap: int) -> Series:
    """`record` as the daemon would take it: up to `max_gap` intervals without a measurement are bridged; a longer gap,
    or an input that nobody holds any longer, ends a segment, and the next measurement begins another."""
    outputs, inputs = record.matrix(network.measured), record.matrix(network.inputs)
    measured = np.asarray(np.isfinite(outputs).any(axis=1))
    usable = np.asarray(np.isfinite(inputs).all(axis=1))
    kept, starts, missing, last = [], [], 0, None
    for row, when in enumerate(record.times.tolist()):
        continues = last is not None and when == last + record.period
        missing = 0 if measured[row] else missing + 1
        if usable[row] and (measured[row] or (continues and missing <= max_gap)):
            kept.append(row)
            starts.append(not continues)
            last = when
    setpoints = record.columns.get(SET_POINTS)
    told = None if setpoints is None else setpoints[kept]
    return Series(record.times[kept], outputs[kept], inputs[kept], np.array(starts, dtype=np.bool_), told)


def pieces(record: ZoneRecord, output: str, inputs: Sequence[str], shortest: float) -> list[Window]:
    """Unbroken stretches of at least `shortest` s without a missing input; each begins with `output` measured."""
    usable = np.asarray(np.isfinite(record.matrix(inputs)).all(axis=1))
    found, measured = [], np.isfinite(record.columns[output])
    for begin, end in unbroken_runs(usable, record.times, record.period):
        first = np.flatnonzero(measured[begin:end])
        if len(first) and (end - begin - first[0]) * record.period >= shortest:
            found.append(Window(int(begin + first[0]), end))
    return found


def held(times: Seconds, values: Array, longest: float) -> Array:
    """`values` (K,) with the last one in place of a missing one, for up to `longest` s."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    return np.where(times - times[last] <= longest, values[last], np.nan)
