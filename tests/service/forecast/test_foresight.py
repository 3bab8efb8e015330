"""The inputs to come: by a forecast of the weather, by yesterday's shape, or held."""

import numpy as np
import pytest
from support.forecasts import fan_of
from support.zone_samples import worker as a_worker

from adapters.reading import Quality
from adapters.units import IDENTITY, conversion
from adapters.weather.forecast import WeatherForecast, WeatherSeries
from estimator.foresight import FADES, SUN_FADES, foreseen, no_day, restored, strays, with_inputs
from estimator.foresight import weather as futures
from estimator.heat.sun import Location
from estimator.heat.terms import with_known_heat
from estimator.network.presets import SOLAR_APERTURE, automatic, network
from service.forecast.foresight import foresee
from service.records.outlook import InputOrigin, Weather, WeatherBook, WeatherLink
from service.records.sample import Sample

PERIOD = 900
DAY = 86400
NET = network("building-67")
START = 10 * DAY
BESIDE = automatic(["T_out", "u_heat", "T_adj_upper"]).validate()
CLOUDY = with_known_heat(automatic(["cloud_cover"]), sun="clear-sky", location=Location(47.87, 11.73))
SUNNY = network("tite").with_solar("T_i", SOLAR_APERTURE).validate()


def outdoors(time):
    return 5.0 + 4.0 * np.sin(2 * np.pi * time / DAY)


def sun(time):
    return max(0.0, 300.0 * np.sin(2 * np.pi * (time / DAY - 0.25)))


def worker():
    return a_worker("ekf", NET.name, PERIOD, max_gap=12, hold_inputs=3600.0)


def fed(zone, steps, first=0, colder=0.0):
    for k in range(first, first + steps):
        time = START + k * PERIOD
        inputs = {"T_out": outdoors(time) - colder, "u_heat": 700.0, "I_sol": sun(time)}
        values = np.array([inputs[name] for name in NET.inputs])
        zone.step(Sample.measured(time, np.array([20.0 + 0.1 * np.sin(k)]), values))
    return zone


def seen(zone, steps, weather=None):
    update = zone.standing.update
    outlook = foresee(zone, zone.standing, steps, *([] if weather is None else [weather]))
    columns = {name: outlook.rows[:, column] for column, name in enumerate(NET.inputs)}
    times = update.forecast.valid_time + PERIOD * np.arange(steps)
    return times, columns, {origin.channel: origin for origin in outlook.origins}


def test_until_a_day_is_known_the_last_values_are_held():
    _, columns, origins = seen(fed(worker(), DAY // PERIOD), 8)
    last = START + (DAY // PERIOD - 1) * PERIOD
    assert (columns["T_out"] == outdoors(last)).all()
    assert (columns["I_sol"] == sun(last)).all()
    assert {origin.origin for origin in origins.values()} == {"held"}


def test_then_outdoor_temperature_and_sun_follow_the_day_before_and_heating_is_held():
    times, columns, origins = seen(fed(worker(), DAY // PERIOD + 30), 2 * DAY // PERIOD)
    assert np.allclose(columns["T_out"], [outdoors(time) for time in times])
    assert np.allclose(columns["I_sol"], [sun(time) for time in times])
    assert (columns["u_heat"] == 700.0).all()
    assert [origins[name].origin for name in ("T_out", "I_sol", "u_heat")] == ["yesterday", "yesterday", "held"]


def test_the_shape_of_a_temperature_begins_with_the_last_value_and_goes_back():
    zone = fed(worker(), DAY // PERIOD)
    fed(zone, 30, DAY // PERIOD, colder=3.0)
    times, columns, _ = seen(zone, 40)
    assert np.allclose(columns["T_out"], [outdoors(time) - 3.0 * np.exp((times[0] - time) / FADES) for time in times])
    assert np.allclose(columns["I_sol"], [sun(time) for time in times])


def known_day(days, inputs):
    """The usual day after so many `days` in which the inputs at a time were those."""
    day = no_day(len(inputs(START)), PERIOD)
    for time in range(START, START + days * DAY, PERIOD):
        day = with_inputs(day, time, np.array(inputs(time)))
    return day


def test_what_is_usual_is_a_mean_of_days_and_the_sun_keeps_the_share_that_it_had_lately():
    day = no_day(3, PERIOD)
    for time in range(START, START + 4 * DAY + DAY // 2, PERIOD):
        clouds = 0.2 if time < START + DAY else 0.5 if time >= START + 4 * DAY else 1.0
        day = with_inputs(day, time, np.array([outdoors(time), 0.0, clouds * sun(time)]))
    times = START + 4 * DAY + DAY // 2 + PERIOD * np.arange(DAY // PERIOD, dtype=float)
    rows = foreseen(SUNNY, day, np.array([outdoors(times[0] - PERIOD), 0.0, 150.0]), times).rows
    clear = np.array([sun(time) for time in times])
    usual = np.where(times < START + 5 * DAY, (0.2 + 3 * 1.0) / 4, (0.2 + 3 * 1.0) / 4 * 0.8 + 0.5 * 0.2) * clear
    assert np.allclose(rows[:, 0], [outdoors(time) for time in times])
    assert 0.55 < rows[0, 2] / usual[0] < 0.85
    assert rows[-24, 2] == pytest.approx(usual[-24], rel=0.08)


def test_a_day_that_was_stored_by_itself_is_the_usual_one():
    day = known_day(1, lambda time: [outdoors(time)])
    again = restored({name: value for name, value in day._asdict().items() if name in ("times", "inputs", "before")})
    assert all((one == other).all() for one, other in zip(again[:2] + again[3:4], day[:2] + day[3:4], strict=True))
    later = with_inputs(again, START + DAY, np.array([outdoors(START) + 2.0]))
    assert later.inputs[0, 0] == pytest.approx(outdoors(START) + 1.0)


def test_a_room_next_door_is_foreseen_as_usual_and_stays_as_far_from_it_as_it_is_now():
    column, day = BESIDE.inputs.index("T_adj_upper"), known_day(3, lambda time: [outdoors(time)] * len(BESIDE.inputs))
    times = START + 3 * DAY + PERIOD * np.arange(DAY // PERIOD, dtype=float)
    rows = foreseen(BESIDE, day, np.full(len(BESIDE.inputs), outdoors(times[0] - PERIOD) + 2.0), times).rows
    away = rows[:, column] - [outdoors(time) for time in times]
    assert away[0] == pytest.approx(2.0)
    assert away[-1] == pytest.approx(2.0 * np.exp(-1 / 7), abs=0.01)


def test_how_far_weather_strays_from_what_is_foreseen_is_learned():
    rng, day, cold, clouds = np.random.default_rng(1), no_day(3, PERIOD), 0.0, 0.0
    for time in range(START, START + 60 * DAY, PERIOD):
        left, cleared = np.exp(-PERIOD / FADES), np.exp(-PERIOD / SUN_FADES)
        cold = left * cold + 2.0 * np.sqrt(1.0 - left**2) * rng.standard_normal()
        clouds = cleared * clouds + 0.25 * np.sqrt(1.0 - cleared**2) * rng.standard_normal()
        day = with_inputs(day, time, np.array([outdoors(time) + cold, 0.0, max(0.0, 1.0 + clouds) * sun(time)]))
    outdoor, heat, share = strays(SUNNY, day)
    # What is usual is itself a mean of few days.
    assert 1.7 < outdoor < 2.8
    assert heat == 0.0
    assert 0.18 < share < 0.35
    assert strays(SUNNY, no_day(3, PERIOD))[0] > outdoor, "before anything is known, more is supposed"
    old = restored({name: value for name, value in day._asdict().items() if name in ("times", "inputs", "before")})
    assert strays(SUNNY, old).tolist() == strays(SUNNY, no_day(3, PERIOD)).tolist()


def test_futures_of_the_weather_stray_as_far_as_they_should_and_are_the_same_for_every_room():
    sds, hours = np.array([2.0, 0.0, 0.5]), 24
    drawn = futures(SUNNY, sds, PERIOD, hours * 4, START)
    found = drawn.chosen(SUNNY, np.arange(61))
    ((column, shift),) = found.shifts
    assert column == 0
    assert np.abs(shift.mean(axis=0)).max() < 1e-9
    wanted = 2.0 * np.sqrt(1.0 - np.exp(-2.0 * 24 * 3600.0 / FADES))
    assert shift[:, -1].std() == pytest.approx(wanted, rel=0.25)
    assert shift[:, 0].std() < 0.35 * wanted
    assert np.corrcoef(shift[:, -1], shift[:, -9])[0, 1] > 0.8
    assert found.sun.min() >= -1.0
    assert np.abs(found.sun.mean(axis=0)).max() < 1e-9
    again = drawn.chosen(SUNNY, np.arange(61, 122))
    assert (again.sun == found.sun).all(), "another draw of the same number has the same weather"
    assert not futures(SUNNY, np.zeros(3), PERIOD, 4, START).shifts


def test_clouds_come_as_usual_within_what_a_sky_has_and_the_sun_strays_with_them():
    def usual(time):
        return 80.0 + 20.0 * np.sin(2 * np.pi * time / DAY)

    day = known_day(3, lambda time: [5.0, 0.0, usual(time)])
    times = START + 3 * DAY + PERIOD * np.arange(DAY // PERIOD, dtype=float)
    seen = foreseen(CLOUDY, day, np.array([5.0, 0.0, usual(times[0] - PERIOD) - 50.0]), times)
    assert seen.by_shape.tolist() == [True, False, True]
    away = -50.0 * np.exp((times[0] - times) / SUN_FADES)
    np.testing.assert_allclose(seen.rows[:, 2], usual(times) + away)
    assert foreseen(CLOUDY, day, np.array([5.0, 0.0, 100.0]), times).rows[:, 2].max() == 100.0
    assert strays(CLOUDY, day)[2] == pytest.approx(0.4 * np.sqrt(2.0 / 3.0)), "nothing strayed in one day of three"
    found = futures(CLOUDY, np.array([0.0, 0.0, 0.4]), PERIOD, 96, START).chosen(CLOUDY, np.arange(61))
    assert found.sun[:, -1].std() == pytest.approx(0.4, rel=0.25)
    assert [CLOUDY.drive[place] for place in found.sunny] == [term.name for term in CLOUDY.terms]


def test_a_fan_uses_it_and_a_plan_goes_before_it():
    zone = fed(worker(), DAY // PERIOD + 30)
    times, _, _ = seen(zone, 24)
    foreseen, values = fan_of(zone, 24), np.array([(outdoors(time), sun(time)) for time in times])
    told = fan_of(zone, 24, {"T_out": values[:, 0], "I_sol": values[:, 1]})
    np.testing.assert_allclose(foreseen.outputs[0].mean, told.outputs[0].mean, rtol=0, atol=1e-9)
    assert [origin.origin for origin in told.origins] == ["plan", "held", "plan"]
    held = fan_of(zone, 24, {"T_out": outdoors(times[0]), "I_sol": 0.0})
    assert held.outputs[0].mean[-1] != pytest.approx(told.outputs[0].mean[-1], abs=1e-3)


def test_a_gap_of_days_forgets_the_shape():
    zone = fed(worker(), DAY // PERIOD + 30)
    fed(zone, 10, 5 * DAY // PERIOD)
    assert seen(zone, 4)[2]["T_out"].origin == "held"


def weather(series, issued, unit="degC", max_age=DAY, given="degC"):
    book = WeatherBook()
    book.put("outlook", WeatherForecast(issued, {"t": series}))
    return Weather({"T_out": WeatherLink("outlook", "t", given, conversion(given, unit), max_age)}, book)


def test_a_forecast_of_the_weather_goes_before_yesterday_as_far_as_it_reaches():
    zone = fed(worker(), DAY // PERIOD + 30)
    now = zone.latest.forecast.issue_time
    hours = now + 3600.0 * np.arange(-1, 5)
    told = weather(WeatherSeries(hours, 20.0 + np.arange(6.0)), now - 7200)
    times, columns, origins = seen(zone, 12, told)
    # A straight line between the hours, at the middle of each interval.
    assert np.allclose(columns["T_out"], 21.0 + (times + PERIOD / 2 - now) / 3600.0)
    assert origins["T_out"] == InputOrigin("T_out", "weather", "outlook", 7200.0, Quality.GOOD)
    times, columns, origins = seen(zone, 40, told)
    assert origins["T_out"].quality is Quality.UNCERTAIN
    assert np.allclose(columns["T_out"][16:], [outdoors(time) for time in times[16:]])


def test_a_forecast_that_is_old_or_in_another_unit_is_not_used():
    zone = fed(worker(), DAY // PERIOD + 30)
    now = zone.latest.forecast.issue_time
    series = WeatherSeries(now + 3600.0 * np.arange(10), np.full(10, 50.0), "degF")
    assert np.allclose(seen(zone, 12, weather(series, now, given="degF"))[1]["T_out"], 10.0)
    assert seen(zone, 12, weather(series, now))[2]["T_out"].origin == "yesterday"
    assert seen(zone, 12, weather(series, now - 2 * DAY, given="degF"))[2]["T_out"].origin == "yesterday"
    empty = Weather({"T_out": WeatherLink("nobody", "t", "degC", IDENTITY, DAY)}, WeatherBook())
    assert seen(zone, 12, empty)[2]["T_out"].origin == "yesterday"
