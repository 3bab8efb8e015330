"""Readings of every kind through alignment and worker: forecasts stay finite, states too, and both recover."""

import math
from typing import Any

import numpy as np
import pytest
from fuzz.fuzzing import structured
from hypothesis import strategies as st

from adapters.edge import Converter, Edge
from adapters.reading import Fault, Quality, Reading
from adapters.units import possible_range
from estimator import registry
from estimator.network import presets
from service.publish.payloads import ForecastPayload, GatePayload, VolatilityPayload
from service.records.record import to_json
from service.records.update import Update
from service.zone.alignment import Alignment, Rules
from service.zone.worker import WorkerSettings, ZoneWorker

PERIOD = 300
START = 1_746_230_400
RECOVERY = 1000
"""Sound samples after which a zone forecasts the room again whatever came before; mostly it takes two."""
NETWORK = presets.network("titeth")
SMALL: dict[str, dict[str, Any]] = {"rbpf": {"particles": 50}, "ekf": {}, "ukf": {}}
ESTIMATORS = {name: registry.build(name, NETWORK, PERIOD, options) for name, options in SMALL.items()}

EXTREMES = st.sampled_from(
    [0.0, -0.0, 1e-300, 1e6, -1e6, 80.0, -60.0, 1e12, 1e30, 1e150, 1e300, math.nan, math.inf, -math.inf]
)
VALUES = st.one_of(st.floats(-60, 80), EXTREMES, st.floats())
READINGS = st.tuples(
    st.sampled_from(NETWORK.channels),
    st.one_of(st.floats(-2 * PERIOD, 2 * PERIOD), st.sampled_from([math.nan, math.inf, -1e18, 1e18, 86400.0, 0.0])),
    VALUES,
    st.sampled_from(list(Quality)),
    st.sampled_from([None, None, None, *Fault]),
)
STEPS = st.lists(st.tuples(st.integers(0, 12), st.lists(READINGS, max_size=5), st.booleans()), max_size=30)


def finite(update: Update) -> None:
    """Every number of a forecast and of its payloads is one; the intervals are in order."""
    for output in update.forecast.outputs:
        assert all(map(math.isfinite, (output.mean, output.median, output.sd)))
        assert output.sd >= 0
        for interval in output.intervals:
            assert math.isfinite(interval.lower)
            assert math.isfinite(interval.upper)
            assert interval.lower <= output.median <= interval.upper
    assert 0 <= update.shown_gate.value <= 1
    assert all(map(math.isfinite, update.parameters))
    for kind in (ForecastPayload, VolatilityPayload, GatePayload):
        to_json(kind.of(update))


def sound(worker: ZoneWorker) -> None:
    """Every array of the estimator's state is finite."""
    if worker.standing is not None:
        for name, array in worker.standing.state._asdict().items():
            if np.asarray(array).dtype.kind == "f":
                assert np.isfinite(array).all(), f"{name} is poisoned"


EDGES = {name: Edge(valid=possible_range(NETWORK.channel_unit(name))) for name in NETWORK.channels}
"""The widest ranges that a configuration can give."""


def delivered(channel: str, time: float, value: float, quality: Quality, fault: Fault | None) -> Reading:
    """A reading as an adapter delivers it, but for its time and quality, which may be any."""
    if fault is not None:
        return Reading(channel, time, value, quality, fault)
    reading = Converter(channel, EDGES[channel]).reading(time, value, quality)
    assert reading is not None
    return reading


def fresh(name: str) -> tuple[Alignment, ZoneWorker]:
    alignment = Alignment(NETWORK, PERIOD, ["bms"], Rules(lateness=60.0, live=True))
    return alignment, ZoneWorker(ESTIMATORS[name], WorkerSettings(3, (0.5, 0.95), 3, 900.0))


def take(alignment: Alignment, worker: ZoneWorker, readings: list[Reading], now: float) -> Update | None:
    """The last update that the readings brought."""
    last = None
    for sample in alignment.add("bms", readings, now):
        update = worker.step(sample)
        if update is not None:
            finite(update)
            last = update
    sound(worker)
    return last


def room(now: float) -> list[Reading]:
    """A room as it is, once in every interval."""
    return [Reading("T_i", now, 20.0 + 0.01 * math.sin(now)), Reading("T_out", now, 5.0), Reading("u_heat", now, 500.0)]


def recovers(alignment: Alignment, worker: ZoneWorker, now: float) -> None:
    """After sound readings the room is forecast as it is; walls that a megawatt has heated take a day or two."""
    for step in range(RECOVERY):
        update = take(alignment, worker, room(now + step * PERIOD), now + step * PERIOD + 61)
        if update is not None and update.outcome == "assimilated":
            (output,) = update.forecast.outputs
            if output.sd < 10.0 and abs(output.mean - 20.0) < 1.0 + 3.0 * output.sd:
                return
    raise AssertionError(f"{worker.progress} {worker.standing}")


@structured(examples=15, name=st.sampled_from(sorted(SMALL)), steps=STEPS)
def test_stream_of_readings(name: str, steps: list[tuple[int, list[Any], bool]]) -> None:
    """Readings as no adapter should deliver them, late, ahead, doubled, infinite, between sound ones."""
    alignment, worker = fresh(name)
    now = float(START)
    for ahead, readings, well in steps:
        now += ahead * PERIOD / 2
        bad = [delivered(channel, now + off, *rest) for channel, off, *rest in readings]
        take(alignment, worker, [*bad, *(room(now) if well else [])], now)
    recovers(alignment, worker, math.ceil(now / PERIOD + 2) * PERIOD)


@structured(
    examples=25,
    name=st.sampled_from(sorted(SMALL)),
    samples=st.lists(
        st.tuples(st.floats(-60, 80) | st.just(math.nan), st.floats(-60, 80), st.floats(-1e6, 1e6), st.integers(1, 3)),
        max_size=40,
    ),
)
def test_believable_nonsense(name: str, samples: list[tuple[float, float, float, int]]) -> None:
    """Values within the default ranges that no room has: jumps over 140 K, heaters of a megawatt, holes."""
    alignment, worker = fresh(name)
    now = float(START)
    for inside, outside, heat, ahead in samples:
        now += ahead * PERIOD
        readings = [Reading("T_i", now, inside), Reading("T_out", now, outside), Reading("u_heat", now, heat)]
        take(alignment, worker, readings, now + 61)
    recovers(alignment, worker, now + PERIOD)


HEATED_WALLS = [
    (20.0, 0.0, 5e5),
    (-40.0, 50.0, -9e5),
    (80.0, -40.0, -5e5),
    (math.nan, -40.0, -9e5),
    (math.nan, 0.0, 5e5),
    (60.0, 50.0, 5e5),
]
"""T_i, T_out and u_heat of samples that leave a UKF with walls so hot and uncertain that days do not bring it back."""


@pytest.mark.parametrize("name", sorted(SMALL))
def test_forecasts_that_say_nothing_begin_a_new_segment(name: str) -> None:
    alignment, worker = fresh(name)
    for step, (inside, outside, heat) in enumerate(HEATED_WALLS):
        now = START + step * PERIOD
        readings = [Reading("T_i", now, inside), Reading("T_out", now, outside), Reading("u_heat", now, heat)]
        take(alignment, worker, readings, now + 61)
    found = [take(alignment, worker, room(now + k * PERIOD), now + k * PERIOD + 61) for k in range(1, 31)]
    assert found[-1].forecast.outputs[0].sd < 10.0
