"""The answers that page and report open with, against a house whose truth is known."""

import re

import numpy as np
import pandas as pd
import pytest
from support.forecasts import asked as answer
from support.thermostat_house import recorded
from support.zone_samples import fed
from support.zone_samples import worker as new

import thermogate as tg
from estimator.diagnosis import finding as kinds
from estimator.diagnosis.finding import Diagnosis, Finding
from estimator.network import presets
from estimator.network.assembly import assemble
from estimator.network.discretise import heat_loss
from replay.reports.language import sayer
from service.forecast import room
from service.forecast.looking_back import needed_heat
from service.forecast.room import MOST, Past, RoomQuestion, _highest, _loss, highest
from service.records.sample import Sample
from service.records.trust import HorizonTrust, Trust

PERIOD, DAYS = 1800, 6
OUTPUTS, INPUTS, SETPOINTS = recorded(DAYS, PERIOD)
TIMES = 1_767_571_200.0 + PERIOD * np.arange(len(OUTPUTS))
PAST = Past(TIMES, PERIOD, OUTPUTS[:, 0], SETPOINTS, np.full((len(OUTPUTS), 3), np.nan), INPUTS)
TRUE_LOSS = 1.0 / (1.0 / 600.0 + 1.0 / 140.0)
"""W/K of the house: its two conductances in series."""


@pytest.fixture(scope="module")
def fitted():
    table = pd.DataFrame(
        {"T_i": OUTPUTS[:, 0], "T_out": INPUTS[:, 0], "u_heat": INPUTS[:, 1], "T_set": SETPOINTS},
        index=pd.to_datetime(TIMES, unit="s", utc=True),
    )
    return tg.fit(table, "tite", estimator="ekf", progress=False)._session.worker


@pytest.fixture
def worker(fitted, monkeypatch):
    """The worker of the house, trusted and without findings until a test says otherwise."""
    monkeypatch.setattr(fitted, "trust", Trust())
    monkeypatch.setattr(fitted, "diagnosis", Diagnosis)
    return fitted


def asked(worker, past=PAST, **about):
    return answer(worker, RoomQuestion(past, **about))


def answers(room):
    return {one.about: one for one in room.answers}


def test_heat_that_the_room_needs_is_what_nobody_measured(worker):
    """Whole, where a filter that expects little of such heat would tell a part."""
    hidden = np.where(np.arange(len(TIMES)) // 6 == 20, 800.0, 0.0)
    less = INPUTS - np.outer(hidden, [0.0, 1.0])
    plain, found = (needed_heat(worker, TIMES, PERIOD, OUTPUTS[:, 0], inputs) for inputs in (INPUTS, less))
    assert found - plain == pytest.approx(hidden, abs=1e-6)
    assert abs(plain.mean()) < 50.0, "of the house nothing is unmeasured"


def test_comfort_counts_hours_against_the_set_point(worker):
    comfort = answers(asked(worker))["comfort"]
    cold = (OUTPUTS[:, 0] < SETPOINTS - 0.5).sum() * PERIOD / 3600.0
    assert cold > 5.0
    assert f"{cold:.0f} h too cold" in comfort.sentence
    assert comfort.value == pytest.approx(cold, abs=3.0), "in a setback it cools down, and is not too warm"


def test_comfort_tells_when_it_was_cold_or_warm_for_longest_in_local_time(worker):
    # The clocks go forward at 2 in the morning of this day.
    times = 1_490_486_400.0 + PERIOD * np.arange(len(TIMES))
    cold = np.full(len(TIMES), 21.0)
    cold[2:4] = 12.0
    cold[60:80] = 16.5
    cold[70] = 14.94
    past = PAST._replace(times=times, temperature=cold, setpoint=np.full(len(TIMES), np.nan))
    told = answers(asked(worker, past, zone="Europe/Copenhagen"))["comfort"].sentence
    assert "; longest too cold from 2017-03-27 08:00 to 18:00, down to 14.9 °C; no set-point" in told
    broken = past._replace(times=times + 7200.0 * (np.arange(len(TIMES)) > 64))
    told = answers(asked(worker, broken, zone="Europe/Copenhagen"))["comfort"].sentence
    assert "longest too cold from 2017-03-27 12:30 to 20:00" in told, "not across a gap"
    told = answers(asked(worker, past._replace(temperature=44.0 - cold)))["comfort"].sentence
    assert "; longest too warm from 2017-03-27 06:00 to 16:00, up to 29.1 °C; " in told
    assert (
        "longest"
        not in answers(asked(worker, past._replace(temperature=np.full(len(TIMES), 21.0))))["comfort"].sentence
    )


@pytest.mark.parametrize("width", [1, 2, 3, 7, 8, 30])
def test_the_highest_set_point_of_a_day_is_that_of_its_intervals(width):
    told = np.random.default_rng(width).normal(size=20)
    told[::3] = np.nan
    found = [np.fmax.reduce(told[max(0, k - width + 1) : k + 1]) for k in range(20)]
    np.testing.assert_array_equal(_highest(told, 1.0, float(width)), found)
    # A month of a zone of one second.
    assert _highest(np.arange(2.4e6), 1.0, 86_400.0)[-1] == 2.4e6 - 1.0


def test_a_room_that_cools_down_over_the_first_night_or_a_weekend_is_not_too_warm(worker):
    hours = np.arange(len(TIMES)) * PERIOD / 3600.0
    # Set back in the first night, and from the evening of the third day on.
    setpoint = np.where((hours > 6.0) & (hours < 68.0), 21.0, 15.0)
    cooling = np.maximum(21.0 - 0.05 * np.maximum(hours - 68.0, 0.0), 17.0)
    found = answers(asked(worker, PAST._replace(setpoint=setpoint, temperature=cooling)))["comfort"]
    assert " 0 h too warm" in found.sentence
    assert highest(np.array([np.nan, 17.0, 21.0, 15.0]), 86_400.0).tolist() == [21.0] * 4
    assert highest(np.repeat([22.0, 20.0], 10), 86_400.0).tolist() == [22.0] * 16 + [20.0] * 4


def test_half_hours_are_rounded_as_the_page_rounds_them(worker):
    told = np.full(len(TIMES), 21.0)
    told[:5] = 17.0
    past = PAST._replace(setpoint=np.full(len(TIMES), np.nan), temperature=told)
    assert ": 3 h too cold and 0 h too warm" in answers(asked(worker, past))["comfort"].sentence


def test_only_the_hours_after_a_setback_are_told_as_such(worker):
    airing = slice(96, 102)
    gain = np.full((len(TIMES), 3), np.nan)
    gain[airing] = [-900.0, -500.0, -100.0]
    cold = OUTPUTS[:, 0].copy()
    cold[airing] = SETPOINTS[airing] - 2.0
    room = asked(worker, PAST._replace(temperature=cold, gain=gain))
    total = (cold < SETPOINTS - 0.5).sum() * PERIOD / 3600.0
    (one,) = room.to_do
    assert one.why == f"it was too cold for {int(total - 3.0 + 0.5)} h after a setback"


def test_without_a_set_point_comfort_is_a_band(worker):
    no_one = PAST._replace(setpoint=np.full(len(TIMES), np.nan), temperature=np.full(len(TIMES), 23.0))
    comfort = answers(asked(worker, no_one))["comfort"]
    assert comfort.sentence.startswith("Comfortable: 0 h too cold and 0 h too warm of 144 h; no set-point is known")
    warm = answers(asked(worker, no_one._replace(temperature=np.full(len(TIMES), 27.0))))["comfort"]
    assert (warm.value, warm.sentence.split(":")[0]) == (24.0 * DAYS, "Often too warm")


def test_loss_energy_and_what_a_kelvin_less_would_have_saved(worker):
    found = answers(asked(worker, area=120.0))
    loss = found["heat_loss"]
    assert loss.lower < loss.value < loss.upper
    assert loss.value == pytest.approx(TRUE_LOSS, rel=0.15)
    assert f"{loss.value / 120.0:.2g} W/K for each m² of floor" in loss.sentence
    assert found["energy"].value == pytest.approx(INPUTS[:, 1].sum() * PERIOD / 3.6e6)
    saved = found["saving"]
    assert saved.value == pytest.approx(loss.value * 24.0 * DAYS / 1000.0, rel=1e-6)
    assert saved.lower == pytest.approx(loss.lower * 24.0 * DAYS / 1000.0, rel=1e-6)


def test_what_hangs_on_a_power_that_was_entered_says_so(worker):
    told = {
        about
        for about, one in answers(asked(worker, entered=True)).items()
        if "was entered for the valve" in one.sentence
    }
    assert told == {"heat_loss", "energy", "saving"}


def test_a_room_that_is_only_cooled_is_told_of_its_cooling(worker):
    loss = answers(asked(worker))["heat_loss"].value
    cooled = PAST._replace(inputs=INPUTS * [1.0, -1.0], setpoint=np.full(len(TIMES), 10.0))
    room = asked(worker, cooled)
    found = answers(room)
    used = INPUTS[:, 1].sum() * PERIOD / 3.6e6
    assert found["energy"].sentence.startswith("The cooling used ")
    assert found["energy"].value == pytest.approx(used)
    assert found["saving"].sentence.startswith("1 K more would have saved about ")
    assert found["saving"].value == pytest.approx(loss * 24.0 * DAYS / 1000.0, rel=1e-6)
    assert [one.what for one in room.to_do] == ["look for what keeps the cooling from following the set-point"]
    full = asked(worker, cooled._replace(inputs=np.full_like(INPUTS, -6000.0)))
    assert [one.why for one in full.to_do] == [f"it was too warm for {24 * DAYS} h at full cooling"]


def test_what_a_room_does_without_heating_is_not_told_where_heating_was_never_measured(worker, monkeypatch):
    record = worker.standing.carried.record
    dark = worker.standing.carried._replace(record=record._replace(largest=np.zeros_like(record.largest)))
    monkeypatch.setattr(worker, "standing", worker.standing._replace(carried=dark))
    found = answers(asked(worker, PAST._replace(inputs=INPUTS * [1.0, 0.0])))
    assert "cooling" not in found
    assert "no heating was measured" in found["heat_loss"].sentence


def test_a_loss_that_cannot_be_believed_saves_nothing(worker, monkeypatch):
    doubt = Diagnosis((Finding(kinds.AGAINST_BALANCE, "heat_loss", "it contradicts the balance; check the unit"),))
    monkeypatch.setattr(worker, "diagnosis", lambda: doubt)
    room = asked(worker)
    found = answers(room)
    assert "do not rely on it" in found["heat_loss"].sentence
    assert np.isnan(found["saving"].value)
    assert ("check the unit", "it contradicts the balance") in [(one.what, one.why) for one in room.to_do]


def test_a_loss_of_which_little_is_known_is_not_told_as_one_number(worker, monkeypatch):
    summary = worker.parameters((0.025, 0.5, 0.975))._replace(heat_loss=np.array([40.9, 561.0, 689.0]))
    monkeypatch.setattr(worker, "parameters", lambda levels: summary)
    found = answers(asked(worker, area=120.0))
    assert found["heat_loss"].sentence == (
        "How much heat it loses is hardly known yet; 95 % between 40.9 and 689 W/K; do not rely on it yet"
    )
    assert np.isnan(found["saving"].value)


def test_the_loss_of_a_room_with_neighbours_is_that_to_outdoors(worker, monkeypatch):
    network = presets.network("ecolar-6r4c")
    theta = np.array([parameter.nominal for parameter in network.parameters])
    matrices, node = assemble(network, theta[:, None]), network.nodes.index(network.measured[0])
    whole = heat_loss(matrices, node)[0]
    # Steady state at 1 K above outdoors, indoors and next door: the heat that this takes is the loss.
    unit = np.eye(len(network.nodes))[node]
    next_door = matrices.inputs[0][:, network.boundaries.index("T_adj")]
    warm, heated = (np.linalg.solve(matrices.internal[0], flow)[node] for flow in (next_door, unit))
    spread = np.array([0.8, 1.0, 1.25])
    summary = worker.parameters((0.025, 0.5, 0.975))._replace(
        parameters=theta[:, None] * spread, heat_loss=whole * spread
    )
    monkeypatch.setattr(worker, "parameters", lambda levels: summary)
    monkeypatch.setattr(type(worker), "network", network)
    found = _loss(worker)
    assert found == pytest.approx((1.0 - warm) / heated * spread)
    assert found[1] < 0.9 * whole


def test_only_rooms_next_door_are_told_as_such(worker, monkeypatch):
    told = {}
    for beside in ("T_adj_hall", "T_rad"):
        monkeypatch.setattr(room, "_beside", lambda network, beside=beside: (beside,))
        monkeypatch.setattr(room, "_loss", lambda worker: np.array([90.0, 100.0, 110.0]))
        told[beside] = "the rooms next door" in answers(asked(worker))["heat_loss"].sentence
    assert told == {"T_adj_hall": True, "T_rad": False}


def test_it_cools_and_heats_as_fast_as_the_house(worker):
    found = answers(asked(worker))
    assert found["cooling"].lower < found["cooling"].value < found["cooling"].upper
    assert 0.5 < found["cooling"].value < 6.0
    # 6000 W into 6 MJ/K of air, held back by the walls.
    assert 1.0 < found["heating"].value < 3.6


def test_a_room_that_was_never_left_unheated_cools_without_heating():
    """Regressions, which carry most of a young bank, know no such thing."""
    told = (Sample.measured(k * 1800, np.array([21.0 + 0.05 * (k % 2)]), np.array([0.0, 1500.0])) for k in range(60))
    assert answers(asked(fed(new("bank", "tite", 1800, hold_inputs=1800.0), told)))["cooling"].value > 0.5


@pytest.mark.parametrize(("period", "told"), [(9, False), (10, True)])
def test_hours_of_seconds_are_not_simulated(period, told):
    samples = (Sample.measured(k * period, np.array([20.0]), np.array([0.0, 500.0])) for k in range(20))
    assert ("cooling" in answers(asked(fed(new("ekf", "tite", period), samples)))) == told


def test_heating_that_nobody_measured_is_told_among_heat_from_elsewhere(worker, monkeypatch):
    largest = worker.standing.carried.record._replace(largest=np.zeros(len(worker.network.inputs)))
    carried = worker.standing.carried._replace(record=largest)
    monkeypatch.setattr(worker, "standing", worker.standing._replace(carried=carried))
    monkeypatch.setattr(room, "_loss", lambda worker: np.array([90.0, 100.0, 110.0]))
    found = answers(
        asked(worker, PAST._replace(inputs=np.zeros_like(PAST.inputs), gain=np.full_like(PAST.gain, 500.0)))
    )
    assert found["heat_loss"].sentence.endswith("do not rely on it, for no heating was measured")
    assert found["saving"].sentence.endswith("is not known, for no heating was measured")
    assert "eat from people, appliances and heating that nobody measures: 500 W" in found["other_heat"].sentence


@pytest.mark.parametrize(("zone", "hour"), [(None, 12), ("Europe/Berlin", 13), ("America/New_York", 7)])
def test_heat_from_elsewhere_is_told_by_the_local_hour(worker, zone, hour):
    at_noon = np.where(TIMES // 3600 % 24 == 12, 240.0, 0.0)
    room = asked(worker, PAST._replace(gain=np.tile(at_noon[:, None], 3)), zone=zone)
    assert room.people[hour] == pytest.approx(240.0)
    assert sum(room.people) == pytest.approx(240.0)
    assert f"10 W on average, 240 W around {hour}:30" in answers(room)["other_heat"].sentence


def test_an_interval_of_two_heats_is_no_interval_of_one_of_them():
    each, hours = np.tile([50.0, 100.0, 150.0], (24, 1)), np.full(24, 100.0)
    sentence = room._heat_answer(room._Elsewhere(each, each), hours, hours, metered=True).sentence
    assert sentence.endswith("; both together, 95 % between 100 and 300 W on average")
    assert sayer("de")(sentence).endswith("; beide zusammen, 95 % zwischen 100 und 300 W im Mittel")


def test_at_most_three_things_are_to_be_done_the_most_important_first(worker, monkeypatch):
    found = [Finding(kind, "zone", f"{kind}; mend {kind}") for kind in reversed(kinds.FINDINGS)]
    monkeypatch.setattr(worker, "diagnosis", lambda: Diagnosis((*found, *found)))
    to_do = asked(worker).to_do
    urgent = kinds.TELEMETRY[:MOST]
    assert [(one.what, one.why) for one in to_do] == [(f"mend {kind}", kind) for kind in urgent]
    found = [one for one in found if one.finding not in kinds.TELEMETRY]
    urgent = (kinds.CALLS_WITHOUT_HEAT, kinds.IMPLAUSIBLE, kinds.HEAT_WITHOUT_CALL)
    assert tuple(one.why for one in asked(worker).to_do) == urgent


def test_in_german_no_part_of_a_sentence_stays_english(worker):
    room = asked(worker, PAST._replace(gain=np.tile([-900.0, -500.0, -100.0], (len(TIMES), 1))), area=120.0)
    assert min(room.people) > -50.0, "what is lost all the time is not people's"
    told = [one.sentence for one in room.answers] + [text for one in room.to_do for text in (one.what, one.why)]
    assert len(told) > 9
    german = [sayer("de")(sentence) for sentence in told]
    left = [text for text in german if re.search(r"\b(the|and|between|not|of|than|on average|most|for)\b", text)]
    assert left == []


def test_what_a_room_was_most_often_is_mended_first(worker):
    place = np.arange(len(TIMES)) % 10
    for often, seldom, what in ((28.0, 15.0, ["warm", "cold"]), (15.0, 28.0, ["cold", "warm"])):
        temperature = np.select([place < 3, place == 5], [often, seldom], 22.0)
        past = PAST._replace(temperature=temperature, setpoint=np.full(len(TIMES), np.nan))
        assert [one.why.split()[3] for one in asked(worker, past).to_do] == what


def cold_all_day(power):
    """The house held 2 K below its set-point at a heating `power` [W]."""
    inputs = np.column_stack([INPUTS[:, 0], np.full(len(TIMES), power)])
    steady = np.full(len(TIMES), 21.0)
    return PAST._replace(setpoint=steady, temperature=steady - 2.0, inputs=inputs)


def airing():
    """The house too cold for 10 h, at full heating, while a window is open, and for 3 h afterwards."""
    past, place = cold_all_day(6000.0), np.arange(len(TIMES))
    cold, opened = (place >= 100) & (place < 126), (place >= 100) & (place < 120)
    return past._replace(temperature=21.0 - 2.0 * cold, gain=np.outer(opened, [-900.0, -500.0, -100.0]))


@pytest.mark.parametrize(
    ("past", "what"),
    [
        (airing(), "keep the windows shut"),
        (PAST, "start heating 1.5 h earlier"),
        (cold_all_day(6000.0), "have the heating looked at"),
        (cold_all_day(100.0), "look for what keeps the heating from following"),
        (PAST._replace(setpoint=SETPOINTS - 9.0), "lower the heating"),
        (PAST._replace(setpoint=SETPOINTS - 9.0, inputs=INPUTS * [1.0, 0.0]), "shade the windows"),
    ],
)
def test_discomfort_has_a_remedy_that_fits_its_cause(worker, past, what):
    (one,) = asked(worker, past).to_do
    assert one.what.startswith(what)
    assert " h" in one.why


def test_forecasts_that_are_no_good_are_told(worker, monkeypatch):
    calm = PAST._replace(setpoint=OUTPUTS[:, 0])
    assert asked(worker, calm).to_do == ()
    beaten = "6 h ahead, no change is the better forecast; rely on the model 1 h ahead"
    monkeypatch.setattr(worker, "trust", Trust(beaten=beaten))
    (one,) = asked(worker, calm).to_do
    assert (one.what, one.why) == (
        "do not let a controller rely on the forecasts yet",
        "6 h ahead, no change is the better forecast",
    )
    good = HorizonTrust(3600, "doubtful", "a window", 0, verified="trusted")
    monkeypatch.setattr(worker, "trust", Trust(0, (good,), beaten=beaten, disturbed=True))
    assert asked(worker, calm).to_do == (), "how far they are good is told with the trust"
    monkeypatch.setattr(worker, "trust", Trust(0, (HorizonTrust(3600, "untrusted", "too narrow", 0),), beaten=beaten))
    (one,) = asked(worker, calm).to_do
    assert one.why == "too narrow"
