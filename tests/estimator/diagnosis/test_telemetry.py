"""Telemetry that lies, in a heated house: what is found, by which name, how soon, and when it is over."""

import numpy as np
import pytest

from estimator.diagnosis.finding import (
    CHANNELS_SWAPPED,
    METER_DEAD,
    METER_LATE,
    SENSOR_DRIFTS,
    SENSOR_JUMPED,
    SENSOR_SPIKES,
    SENSOR_STUCK,
    SIGN_FLIPPED,
    UNIT_CHANGED,
    Finding,
)
from estimator.diagnosis.telemetry import lies
from estimator.diagnosis.telemetry.lies import Suspicion, among, believed, looked
from estimator.diagnosis.telemetry.recent import nothing_recent, with_measured
from estimator.network.presets import network
from estimator.thermostat.memory import no_memory
from tests.support.thermostat_house import morning, recorded

PERIOD = 600
DAY = 86400 // PERIOD
NETWORK = network("tite")
CLEAN, LYING, AFTER = 9 * DAY, 4 * DAY, 3 * DAY


@pytest.fixture(scope="module")
def rows():
    """(n, 3): room, outdoor and heating of a house with a thermostat, whose outdoor thermometer has some noise."""
    outputs, inputs, _ = recorded(30, PERIOD)
    inputs[:, 0] += 0.05 * np.random.default_rng(3).standard_normal(len(inputs))
    return np.column_stack([outputs, inputs])


def watched(rows, begin=0, known=None):
    """(what is recent, suspicions) after every hour from row `begin` on; `known` are these after CLEAN rows."""
    recent, stood = known or (nothing_recent(2, PERIOD), ())
    for place, row in list(enumerate(rows))[CLEAN if known else 0 :]:
        recent = with_measured(recent, place * PERIOD, row[0], row[1:])
        if place % 6 == 5:
            before, time = stood, (place + 1) * PERIOD
            stood = looked(NETWORK, recent, before, time, no_memory(2))
            recent = believed(NETWORK, recent, before, stood, time)
            if place >= begin:
                yield recent, stood


@pytest.fixture(scope="module")
def clean(rows):
    """What is recent and suspected after CLEAN of `rows`, with which most tests go on."""
    *_, known = watched(rows[:CLEAN])
    return known


def warmer_from_day_10():
    outputs, inputs, _ = recorded(14, PERIOD, lambda hour: morning(hour) + (2.0 if hour >= 10 * 24 else 0.0))
    return np.column_stack([outputs, inputs])


def spikes(column):
    return np.where(np.arange(len(column)) % 25 == 7, column + 6.0, column)


LIES = {
    "stuck": (0, lambda rows: np.full(len(rows), rows[0, 0]), SENSOR_STUCK, 3),
    "spikes": (0, lambda rows: spikes(rows[:, 0]), SENSOR_SPIKES, 12),
    "offset": (0, lambda rows: rows[:, 0] + 2.0, SENSOR_JUMPED, 3),
    "drift": (0, lambda rows: rows[:, 0] + 0.1 * np.arange(len(rows)) * PERIOD / 3600.0, SENSOR_DRIFTS, 48),
    "outdoor stuck": (1, lambda rows: np.full(len(rows), rows[0, 1]), SENSOR_STUCK, 3),
    "outdoor flipped": (1, lambda rows: -rows[:, 1], SIGN_FLIPPED, 24),
    "kW": (2, lambda rows: rows[:, 2] / 1000.0, UNIT_CHANGED, 12),
    "mW": (2, lambda rows: rows[:, 2] * 1000.0, UNIT_CHANGED, 12),
    "sign": (2, lambda rows: -rows[:, 2], SIGN_FLIPPED, 12),
    "dead": (2, lambda rows: np.zeros(len(rows)), METER_DEAD, 24),
    "late": (2, lambda rows: np.concatenate([rows[:6, 2], rows[:-6, 2]]), METER_LATE, 24),
}
"""Column, what it tells instead, the name of the finding and in how many hours it is found."""


@pytest.mark.parametrize("lie", LIES)
def test_a_lie_is_found_by_its_name(rows, clean, lie):
    column, told, name, within = LIES[lie]
    lying = rows.copy()
    part = slice(CLEAN, CLEAN + LYING)
    lying[part, column] = told(rows[part])
    looks = watched(lying[: CLEAN + within * 6], CLEAN, clean)
    assert (name, column) in {(one.name, one.column) for _, stood in looks for one in stood}


def test_exchanged_channels_are_found_and_nothing_else_is_said_of_them(rows, clean):
    lying = rows[: CLEAN + 24].copy()
    lying[CLEAN:, [0, 1]] = lying[CLEAN:, [1, 0]]
    *_, (_, stood) = watched(lying, CLEAN, clean)
    assert [(one.name, one.column) for one in stood] == [(CHANNELS_SWAPPED, 1)]


def test_nothing_is_suspected_of_a_house_that_tells_the_truth_also_when_its_set_point_is_raised_for_good(rows):
    for told in (rows, warmer_from_day_10()):
        assert not [stood for _, stood in watched(told) if stood]


def test_a_dead_meter_of_an_on_off_heater_is_found_before_the_night():
    outputs, inputs, _ = recorded(10, PERIOD, power=lambda excess: 6000.0 * (excess < 0.0))
    inputs[CLEAN + 15 * 6 :, 1] = 0.0
    *_, (_, stood) = watched(np.column_stack([outputs, inputs])[: CLEAN + 22 * 6], CLEAN)
    assert [(one.name, one.column) for one in stood] == [(METER_DEAD, 2)]


def test_a_party_before_the_set_point_is_raised_is_no_jump():
    """It warms the room by 3.3 K in half an hour: by and by."""
    told, begin = warmer_from_day_10(), CLEAN + 18 * 6
    told[begin : begin + 24, 0] += np.interp(np.arange(24), [0, 2, 12, 23], [1.1, 3.3, 3.3, 0.0])
    assert SENSOR_JUMPED not in {one.name for _, stood in watched(told, CLEAN) for one in stood}


def test_neither_a_window_nor_somebody_who_cooks_is_a_jump(rows, clean):
    for slots, warmer in (([0, 2, 36, 47], [-1.4, -3.6, -3.6, 0.0]), ([0, 1, 2, 3], [0.7, 2.6, 1.7, 0.0])):
        told, begin = rows[: CLEAN + DAY].copy(), CLEAN + 3 * 6
        told[begin : begin + 48, 0] += np.interp(np.arange(48), slots, warmer)
        assert SENSOR_JUMPED not in {one.name for _, stood in watched(told, CLEAN, clean) for one in stood}


@pytest.mark.parametrize(
    ("gathered", "found", "stands"), [(30.0, True, True), (15.0, False, True), (10.0, False, False)]
)
def test_a_suspicion_that_wavers_about_its_limit_does_not_come_and_go(gathered, found, stands):
    past, new = np.zeros((DAY, 3)), np.zeros((6, 3))
    look = lies.Look(lies.kinds(NETWORK), 1 / 6, past, new, None, np.full(DAY + 6, np.nan), frozenset())
    ratios = np.repeat([-1.0, gathered / 6], [DAY, 6])
    for stood, told in ((), found), ([(METER_LATE, 2)], stands):
        hours = lies._evident(look._replace(stood=frozenset(stood)), lambda begin: ratios[begin:], METER_LATE, 2)
        assert hours == (pytest.approx(1.0) if told else None)


@pytest.mark.parametrize("off", [slice(CLEAN, CLEAN + LYING), slice(0, CLEAN)], ids=["off", "on again"])
def test_noise_of_a_heater_that_is_off_is_no_other_unit(rows, off):
    told = rows[: CLEAN + LYING].copy()
    told[off, 2] = np.random.default_rng(4).uniform(0.03, 0.13, len(told[off]))
    assert UNIT_CHANGED not in {one.name for _, stood in watched(told, CLEAN) for one in stood}


@pytest.mark.parametrize("lie", sorted(LIES.keys() - {"mW", "late"}))
def test_a_suspicion_ends_with_the_lie(rows, clean, lie):
    column, told, name, _ = LIES[lie]
    lying = rows[: CLEAN + DAY + AFTER].copy()
    lying[CLEAN : CLEAN + DAY, column] = told(rows[CLEAN : CLEAN + DAY])
    *_, (_, stood) = watched(lying, CLEAN + DAY, clean)
    assert name not in {one.name for one in stood}


def test_what_a_thermometer_told_while_it_was_suspected_is_no_reference():
    recent, half = nothing_recent(2, PERIOD), DAY // 2
    for place in range(DAY):
        recent = with_measured(recent, place * PERIOD, 20.0, np.array([5.0, 100.0]))
    stood = (Suspicion(SENSOR_STUCK, 0, half * PERIOD), Suspicion(METER_DEAD, 2, 0.0))
    missing = np.isnan(believed(NETWORK, recent, stood, (), DAY * PERIOD).values[:DAY])
    assert missing.tolist() == [[place >= half, False, False] for place in range(DAY)]
    assert believed(NETWORK, recent, stood, stood, DAY * PERIOD) is recent
    assert believed(NETWORK, recent, stood, (), 8 * DAY * PERIOD) is recent


def test_a_slot_keeps_its_first_temperature_or_a_spike():
    recent = nothing_recent(0, 300)
    for place, told in enumerate([20.0, 20.5, 21.0, 20.9, 21.0, 29.0, 20.0, 21.0]):
        recent = with_measured(recent, place * 300, told, np.empty(0))
    assert recent.values[:4, 0].tolist() == [20.0, 21.0, 29.0, 20.0]


def test_a_suspicion_keeps_the_time_at_which_it_began(rows, clean):
    lying = rows[: CLEAN + DAY].copy()
    lying[CLEAN:, 0] = lying[CLEAN, 0]
    begun = {one.since for _, stood in watched(lying, CLEAN, clean) for one in stood if one.name == SENSOR_STUCK}
    assert len(begun) == 1
    assert abs(begun.pop() - CLEAN * PERIOD) <= PERIOD


def test_missing_rows_are_no_lie(rows):
    patchy = rows.copy()
    patchy[12 * DAY : 13 * DAY] = np.nan
    patchy[np.random.default_rng(1).random(patchy.shape) < 0.1] = np.nan
    # An hour that is never measured.
    hours = np.arange(len(rows)) * PERIOD // 3600 % 24
    for told in (patchy, np.where((hours == 4)[:, None], np.nan, rows)):
        assert not [stood for _, stood in watched(told) if stood]


def test_a_finding_names_the_channel_and_takes_the_place_of_the_last_one():
    about_model = Finding("parameter-at-bound", "C_i", "a sentence")
    findings = among((about_model,), NETWORK, (Suspicion(UNIT_CHANGED, 2, 0.0), Suspicion(SENSOR_STUCK, 0, 0.0)))
    assert [(one.finding, one.subject) for one in findings] == [
        (SENSOR_STUCK, NETWORK.measured[0]),
        (UNIT_CHANGED, NETWORK.inputs[1]),
        ("parameter-at-bound", "C_i"),
    ]
    assert NETWORK.inputs[1] in findings[1].sentence
    assert among(findings, NETWORK, ()) == (about_model,)
