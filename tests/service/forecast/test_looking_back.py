"""What an open window cost, and why the forecasts of the last day were wrong."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.tables import tabled

from replay.reports.language import sayer
from service.forecast.looking_back import last_day, lost_heat, warming_up

STEP, DAYS = 600.0, 5
TIMES = 1_767_571_200.0 + STEP * np.arange(DAYS * 144)
CALM = np.tile([-80.0, 0.0, 90.0], (len(TIMES), 1))


def lost(times, step, gain, zone, needed=None):
    return list(lost_heat(times, step, gain, zone, gain[:, 1] if needed is None else needed))


def opened(*stretches):
    """Gain with windows open over `stretches` of places, each with its heat [W]."""
    gain = CALM.copy()
    for first, last, watts in stretches:
        gain[first:last] = -watts + np.array([-100.0, 0.0, 100.0])
    return gain


def test_heat_lost_through_windows_is_the_sum_of_what_was_lost_for_certain():
    gain = opened((72, 78, 1200.0), (300, 303, 900.0), (400, 500, 90.0))
    (answer,) = lost(TIMES, STEP, gain, "Europe/Berlin")
    assert answer.value == pytest.approx(1.2 + 0.45), "the third may be nothing"
    assert (answer.lower, answer.upper) == (pytest.approx(1.1 + 0.37), pytest.approx(1.3 + 0.5 + 0.08 / 3.0))
    assert "; 1.2 kWh of it from 2026-01-05 12:50 to 14:00" in answer.sentence, "the filter is sure an interval later"
    assert "kein" not in sayer("de")(answer.sentence)
    gain[[70, 71, 78]] = -1300.0, -1200.0, 0.0
    (answer,) = lost(TIMES, STEP, gain, "Europe/Berlin")
    assert "; 1.8 kWh of it from 2026-01-05 12:30 to 14:10" in answer.sentence, "sure only after a while"
    assert (answer.lower, answer.upper) == (pytest.approx(1.1 + 0.37), pytest.approx(1.3 + 0.5 + 0.65 + 0.08 / 3.0))
    (twice,) = lost(TIMES, STEP, gain, "Europe/Berlin", 2.0 * gain[:, 1])
    width = answer.upper - answer.lower
    assert (twice.value, twice.upper - twice.lower) == (pytest.approx(2.0 * answer.value), pytest.approx(width))


def test_a_gap_parts_two_losses():
    gain = opened((72, 84, 1200.0))
    times = TIMES.copy()
    times[78:] += 86_400.0
    (answer,) = lost(times, STEP, gain, None)
    assert answer.value == pytest.approx(2.4)
    assert "; 1.2 kWh of it from 2026-01-05 11:50 to 13:00" in answer.sentence
    (answer,) = lost(TIMES, STEP, opened((72, 84, 1200.0)), None)
    assert answer.sentence.endswith("; all of it from 2026-01-05 11:50 to 14:00")
    (answer,) = lost(TIMES, STEP, opened((138, 150, 1200.0)), None)
    assert answer.sentence.endswith("; all of it from 2026-01-05 22:50 to 2026-01-06 01:00")


def test_heat_that_is_lost_too_often_is_no_window():
    (answer,) = lost(TIMES, STEP, opened((100, 180, 900.0)), None)
    assert answer.sentence.startswith("What an open window took away is not known")
    assert sayer("de")(answer.sentence).endswith("denn 11 % der Zeit kommt und geht Wärme, die niemand misst")
    assert np.isnan(answer.value)


def test_a_closed_window_is_told_and_an_unknown_gain_is_not():
    (answer,) = lost(TIMES, STEP, CALM, None)
    assert answer.sentence == "No open window was noticed in 5.0 days"
    assert list(lost(TIMES, STEP, np.full_like(CALM, np.nan), None)) == []


def mornings(*delays, days=5):
    """Temperature and set-point with a setback every night, and a room that is warm so many intervals after its end."""
    setpoint = np.tile(np.repeat([17.0, 21.0, 17.0], [36, 96, 12]), days)
    temperature = setpoint.copy()
    for day, delay in enumerate(delays):
        temperature[144 * day + 36 :][:delay] = 19.0
    return temperature, setpoint


def test_warming_up_takes_as_long_as_the_room_was_too_cold_after_a_setback():
    (answer,) = warming_up(STEP, *mornings(6, 9, 9, 12, 18), 0.5)
    assert answer.sentence == (
        "After a setback it took 1.5 h to be warm again, at most 3.0 h; start heating so long before it is to be warm"
    )
    assert (answer.value, answer.unit) == (1.5, "h")
    assert sayer("de")(answer.sentence).startswith("Nach einer Absenkung dauerte es 1,5 h, bis er wieder warm war, h")
    (answer,) = warming_up(STEP, *mornings(6, 200, 6), 0.5)
    assert answer.sentence.endswith("1 of 5 times it was not warm before the next setback")
    (answer,) = warming_up(STEP, *mornings(0, 0, 6), 0.5)
    assert answer.sentence == "After most setbacks it was warm again at once, else after at most 1.0 h"
    assert "0.0 h" not in answer.sentence
    (answer,) = warming_up(STEP, *mornings(), 0.5)
    assert answer.sentence == "After a setback it was warm again at once"


def test_a_rise_within_an_interval_is_one_and_a_room_without_setbacks_says_nothing():
    temperature, setpoint = mornings(6, 6, 6, 6, 6)
    setpoint[36::144] = 19.0
    assert [one.value for one in warming_up(STEP, temperature, setpoint, 0.5)] == [1.0]
    assert list(warming_up(STEP, temperature, np.full_like(setpoint, 21.0), 0.5)) == []
    assert list(warming_up(STEP, temperature, np.full_like(setpoint, np.nan), 0.5)) == []


def test_a_rise_in_two_steps_is_no_setback_and_a_gap_is_no_cold_room():
    temperature, setpoint = mornings(6, 6, 6, 6, 6)
    setpoint[36:39] = 18.0
    (answer,) = warming_up(STEP, temperature, setpoint, 0.5)
    assert (answer.value, "not warm" in answer.sentence) == (1.0, False)
    temperature, setpoint = mornings(6, 18, 6)
    temperature[144 + 38 : 144 + 72] = np.nan
    (answer,) = warming_up(STEP, temperature, setpoint, 0.5)
    assert answer.sentence.startswith("After a setback it took 0.5 h to be warm again, at most 1.0 h; start")


def worker(issued, known, forecasts=20, recorded=7, usual=None):
    def window(days, error):
        count = forecasts * min(days, recorded)
        error = error if days == 1 or usual is None else usual
        return tuple(SimpleNamespace(lead=lead, forecasts=count, rmse=error) for lead in (3600, 21600, 86400))

    skill = SimpleNamespace(over=lambda days: window(days, known), issued_over=lambda days: window(days, issued))
    network = SimpleNamespace(inputs=("T_out", "u_heat"), channel_unit={"T_out": "degC", "u_heat": "W"}.get)
    return SimpleNamespace(skill=lambda: skill, network=network)


def asked(of, inputs=None, gain=None):
    usual = np.column_stack([5.0 + np.sin(TIMES / 13750.0), 500.0 + 400.0 * np.cos(TIMES / 9000.0)])
    nothing = np.zeros(len(TIMES))
    return list(last_day(of, TIMES, STEP, usual if inputs is None else inputs, nothing if gain is None else gain))


def test_forecasts_that_were_right_need_no_reason():
    (answer,) = asked(worker(0.3, 0.2))
    assert answer.sentence == "In the last day the forecasts 6 h ahead were off by 0.3 K; 0.3 K is usual"
    assert (answer.value, answer.unit) == (0.3, "K")
    assert asked(worker(0.3, 0.2, forecasts=3)) == []
    (first,) = asked(worker(0.3, 0.2, recorded=1))
    # Nothing is usual on a first day.
    assert first.sentence == "In the last day the forecasts 6 h ahead were off by 0.3 K"


def test_an_input_that_came_otherwise_is_named():
    inputs = np.column_stack([np.full(len(TIMES), 5.0), np.where(TIMES[-1] - 86_400.0 < TIMES, 1500.0, 500.0)])
    (answer,) = asked(worker(1.4, 0.4), inputs)
    assert "with both known it would have been 0.4 K; the heating was 1000 W above what is usual" in answer.sentence
    assert sayer("de")(answer.sentence).endswith("die Heizung lag 1000 W über dem, was zu der Stunde üblich ist")
    # One that was never measured is no reason.
    inputs[:, 0] = np.nan
    assert asked(worker(1.4, 0.4), inputs) == [answer]


@tabled
def test_heat_that_nobody_measures_is_named_with_its_energy(power, why, german):
    (answer,) = asked(worker(1.4, 1.3), gain=np.where(TIMES[-1] - 6 * 3600.0 < TIMES, power, 0.0))
    assert answer.sentence.endswith(why)
    assert sayer("de")(answer.sentence).endswith(german)


def test_a_small_error_has_a_reason_where_it_is_unlike_the_usual_and_the_reason_is_known():
    opened = np.where(TIMES[-1] - 6 * 3600.0 < TIMES, -400.0, 0.0)
    told = "In the last day the forecasts 6 h ahead were off by 0.4 K; 0.2 K is usual"
    assert asked(worker(0.4, 0.4, usual=0.2), gain=opened)[0].sentence.startswith(f"{told}; an open window took")
    assert asked(worker(0.4, 0.4, usual=0.2))[0].sentence == told
    assert asked(worker(0.4, 0.4, usual=0.3), gain=opened)[0].sentence.endswith("0.3 K is usual")


def test_else_the_model_does_not_know_the_room_well_enough():
    (answer,) = asked(worker(1.4, 1.3))
    assert answer.sentence.endswith("so the model does not know this room well enough")
