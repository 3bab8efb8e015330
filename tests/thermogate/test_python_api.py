"""`import thermogate as tg`: tables in, forecasts and what was learned out."""

import json
import warnings
from contextlib import contextmanager
from datetime import timedelta, timezone
from functools import cache
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import pandas as pd
import pytest
from dateutil.tz import tzoffset
from support.golden_site import TWO_SENSORS
from support.harness import python
from support.saved_models import as_saved_before
from support.tables import tabled

import thermogate as tg
from estimator.network import presets
from service.config.site import ZoneTable

FEW: dict[str, Any] = {"estimator": "ekf"}
MISTAKES = json.loads(Path(__file__).with_name("mistakes.json").read_text(encoding="utf-8"))


def room(start="2025-01-10 00:00", samples=60, tz="UTC", period="10min"):
    """A heated room: degC and W, from `start` on."""
    index = pd.date_range(start, periods=samples, freq=period, tz=tz)
    step = np.arange(samples)
    heat = np.where(step // 18 % 2 == 0, 1500.0, 200.0)
    outside = 4.0 + 3.0 * np.sin(step / 23.0)
    inside = np.empty(samples)
    inside[0] = 20.0
    for k in range(1, samples):
        inside[k] = inside[k - 1] + 0.02 * (outside[k - 1] - inside[k - 1]) + heat[k - 1] * 2.6e-4
    noise = 0.03 * np.sin(7.0 * step)
    return pd.DataFrame({"T_i": inside + noise, "T_out": outside, "u_heat": heat}, index=index)


@pytest.fixture
def model():
    return in_utc("2025-01-10 00:00")


@cache
def in_utc(start):
    """A model of the room from `start` on."""
    return tg.fit(room(start), "tite", **FEW)


def bits(frame):
    return [np.ascontiguousarray(frame[name]).tobytes() for name in frame if frame[name].dtype.kind in "fi"]


def assert_same(left, right):
    for name in ("predictions", "volatility", "parameter_history", "disturbance"):
        assert bits(getattr(left, name)) == bits(getattr(right, name)), name
        assert (getattr(left, name).index == getattr(right, name).index).all()
    assert bits(left.forecast(horizon="1h")) == bits(right.forecast(horizon="1h"))
    assert left.skill().equals(right.skill())


def test_the_defaults_are_those_of_the_daemon():
    table = room(samples=8)
    assert tg.fit(table, "tite", estimator_options={"particles": 50}).estimator == "rbpf"
    model = tg.fit(table, "tite")
    assert model.estimator == ZoneTable.model_fields["estimator"].default
    assert model.period == timedelta(minutes=10)
    assert list(model.predictions.columns[:5]) == ["y", "mean", "sd", "lower_0.95", "upper_0.95"]


@pytest.mark.parametrize("given", ["10min", 600, timedelta(minutes=10), pd.Timedelta("10min")])
def test_a_period_is_written_as_in_the_configuration_or_a_timedelta(given, model):
    assert_same(tg.fit(room(), "tite", period=given, **FEW), model)


def test_a_network_is_a_name_a_table_or_an_object(model):
    assert_same(tg.fit(room(), presets.network("tite"), **FEW), model)
    changed = tg.fit(room(), {"preset": "tite", "parameters": {"C_i": {"value": 2e6}}}, **FEW)
    assert not changed.parameters().loc["C_i", "free"]
    assert changed.parameters().loc["C_i", "q0.5"] == 2e6


def test_the_network_auto_follows_from_the_columns():
    table = room().assign(T_adj=18.0, unused=1.0, cloud_cover=50.0).rename(columns={"T_i": "Room"})
    network = tg.fit(table, "auto", columns={"T_i": "Room"}, **FEW).network
    assert network.channels == ("T_i", "T_out", "T_adj", "u_heat")
    under_clouds: dict[str, Any] = {"sun": "clear-sky", "latitude": 47.7, "longitude": 9.2, "estimator": "mkf"}
    network = tg.fit(table, "auto", columns={"T_i": "Room"}, estimator_options={"particles": 8}, **under_clouds).network
    assert network.channels == ("T_i", "T_out", "T_adj", "u_heat", "cloud_cover")


def test_columns_have_other_names_units_and_order(model):
    table = room()
    raw = pd.DataFrame(
        {"Room": table["T_i"] + 273.15, "Heating kW": table["u_heat"] / 1000, "Out": table["T_out"], "Hum": 40.0}
    ).iloc[::-1]
    found = tg.fit(raw, "tite", columns={"T_i": ("Room", "K"), "u_heat": ("Heating kW", "kW"), "T_out": "Out"}, **FEW)
    np.testing.assert_allclose(found.predictions["mean"], model.predictions["mean"], rtol=1e-9)
    plan = pd.DataFrame({"Room": 293.0, "Heating kW": 1.0, "Hum": 40.0}, index=found.forecast(horizon="1h").index)
    assert bits(found.forecast(plan, "1h")) == bits(found.forecast({"u_heat": 1000.0}, "1h"))


def test_the_usual_distance_of_the_rows_is_the_period():
    assert tg.fit(room().drop(room().index[[7, 20, 21]]), "tite", **FEW).period == timedelta(minutes=10)


def test_an_end_without_measurements_leaves_no_forecast():
    table = room(samples=80)
    table.loc[table.index[40:], "T_i"] = np.nan
    model = tg.fit(table, "tite", **FEW)
    assert "no forecast: no measurement of T_i" in repr(model)
    with pytest.raises(tg.DataError, match="no forecast: no measurement of T_i for 40 steps"):
        model.forecast()


class Nameless(tzoffset):
    """As pytz's FixedOffset is: without a name to find it by."""

    zone = None


BERLIN, KOLKATA = "Europe/Berlin", ZoneInfo("Asia/Kolkata")
JANUARY, JULY, AUTUMN = "2025-01-10 00:00", "2025-07-01 00:00", "2024-10-26 20:00"
NAMELESS = (Nameless("x", 7200), tzoffset("x", 7200), timezone(timedelta(hours=1, seconds=30)))
# In July, the zone that is called CET is two hours from UTC.
NAMED = [timezone(timedelta(hours=hours), name) for hours, name in ((1.0, "CET"), (-3.5, "here"), (0.0, "WET"))]


@pytest.mark.parametrize(
    ("start", "zone", "tz", "shown"),
    [
        (JANUARY, "America/New_York", None, "America/New_York"),
        (JANUARY, "UTC+02:00", None, "UTC+02:00"),
        (JANUARY, timezone(timedelta(hours=-3)), None, "UTC-03:00"),
        (JANUARY, KOLKATA, KOLKATA, "Asia/Kolkata"),
        (JANUARY, "UTC", BERLIN, BERLIN),
        # The hour that autumn repeats is told apart by the order of the rows.
        (AUTUMN, BERLIN, BERLIN, BERLIN),
        *(
            (JULY, zone, tz, shown)
            for zone, shown in zip(NAMED, ("UTC+01:00", "UTC-03:30", "UTC"), strict=True)
            for tz in (None, zone)
        ),
        *((JANUARY, zone, None, "UTC") for zone in NAMELESS),
    ],
)
def test_times_mean_the_same_in_every_zone(start, zone, tz, shown):
    local = room(start).tz_convert(zone)
    found = tg.fit(local.tz_localize(None) if zone == tz else local, "tite", tz=tz, **FEW)
    assert_same(found, in_utc(start))
    assert {str(found.gate.index.tz), str(found.forecast(horizon="1h").index.tz)} == {shown}


@pytest.mark.parametrize("zone", NAMELESS)
def test_a_zone_without_a_name_cannot_be_given(zone):
    for table in (room().tz_convert(zone), room().tz_localize(None)):
        with pytest.raises(tg.DataError, match=r"tz: the time zone .*; give a name such as .* or an offset such as"):
            tg.fit(table, "tite", tz=zone, **FEW)


@contextmanager
def silence():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def test_faults_of_rows_that_are_passed_over_are_not_told_again():
    table = room(samples=80)
    table.loc[table.index[[5, 70]], "T_i"] = [300.0, 400.0]
    with pytest.warns(UserWarning, match="not used"):
        model = tg.fit(table.iloc[:60], "tite", **FEW)
    with silence():
        model.update(table.iloc[:65])
    assert model.faults == {"out_of_range": 1}
    with pytest.warns(
        UserWarning, match=r'"T_i": 1 value not used \(out of range\), the first 400 at 2025-01-10 11:40'
    ) as told:
        model.update(table)
    assert (len(told), model.faults) == (1, {"out_of_range": 2})


SPRING = room("2025-03-30 00:00", samples=60, tz=None)
"""Spring skips rows 12 to 17."""


def test_times_that_cannot_be_and_are_passed_over_are_not_counted_again():
    whole = {"tz": BERLIN, **FEW}
    model = tg.fit(SPRING.iloc[:12], "tite", **whole)
    with pytest.warns(UserWarning, match=r"18 readings not used \(bad timestamp\)"):
        model.update(SPRING.iloc[:30])
    with silence():
        model.update(SPRING)
    assert model.faults == {"bad_timestamp": 18}
    with pytest.warns(UserWarning, match="bad timestamp"):
        assert_same(model, tg.fit(SPRING, "tite", **whole))
    ancient = room("1969-12-31 22:00", samples=80)
    with pytest.warns(UserWarning, match="bad timestamp"):
        model = tg.fit(ancient.iloc[:60], "tite", **FEW)
    before = model.faults
    with silence():
        assert model.update(ancient).faults == before


def test_values_that_cannot_be_are_not_used_and_named():
    table = room()
    table.loc[table.index[[5, 9]], "T_i"] = [300.0, np.inf]
    with pytest.warns(UserWarning, match="not used") as told:
        model = tg.fit(pd.concat([table, table.iloc[:1]]), "tite", **FEW)
    assert model.faults == {"out_of_range": 1, "not_finite": 1, "duplicated": 3}
    sentences = "".join(str(one.message) for one in told)
    assert 'column "T_i": 1 value not used (out of range), the first 300 at 2025-01-10 00:50:00+00:00' in sentences
    assert "the table: 3 readings not used (duplicated)" in sentences
    assert all(one.filename == __file__ for one in told)
    assert "1 out_of_range" in repr(model)


def test_what_looks_wrong_is_told_with_what_to_write_instead():
    table = room(samples=200)
    wrong = table.assign(T_i=9.0 / 5.0 * table["T_i"] + 32.0, u_heat=table["u_heat"] / 1000.0)
    with pytest.warns(UserWarning, match="if it is in (kW|degF)|are the two swapped") as told:
        tg.fit(wrong, "tite", **FEW)
    sentences = " ".join(str(one.message) for one in told)
    assert 'write columns={"u_heat": ("u_heat", "kW")}, with the name of its column' in sentences
    assert 'write columns={"T_i": ("T_i", "degF")}' in sentences


def test_going_on_later_is_the_same_as_one_table():
    table, cut = room(samples=100), 47
    model = tg.fit(table.iloc[:cut], "tite", **FEW)
    assert model.update(table.iloc[cut - 5 :]) is model
    assert_same(model, tg.fit(table, "tite", **FEW))
    with pytest.raises(tg.DataError, match="learned up to 2025-01-10 16:40:00"):
        model.update(table)


@tabled
def test_a_saved_model_goes_on_with_the_same_bits(estimator, options, tmp_path):
    table, cut, path = room(samples=60), 40, tmp_path / "room.model"
    model = tg.fit(table.iloc[:cut], "tite", estimator=estimator, estimator_options=options, seed=3)
    model.save(path)
    with np.load(path, allow_pickle=False) as stored:
        assert not any(stored[name].dtype.hasobject for name in stored.files)
    loaded = tg.load(str(path))
    assert repr(loaded) == repr(model)
    assert_same(loaded, model)
    assert_same(loaded.update(table.iloc[cut:]), model.update(table.iloc[cut:]))
    plan = {"u_heat": [100.0 * step for step in range(6)]}
    assert bits(loaded.forecast(plan, "1h")) == bits(model.forecast(plan, "1h"))
    assert [file.name for file in tmp_path.iterdir()] == ["room.model"]


def test_sun_and_habits_are_learned_told_and_saved(tmp_path):
    table = room(samples=50)
    table["I_sol"] = 300.0
    options: dict[str, Any] = {"estimator": "mkf", "estimator_options": {"preset": "habits"}}
    model = tg.fit(
        table, "auto", latitude=47.67, longitude=9.17, country="DE", floor_area=30, built=1965, use="office", **options
    )
    known = model.known_heat([0.5])
    assert known.loc["sun_south", "unit"] == "m2"
    assert known.loc["habit_06", "node"] == "T_i"
    assert known.loc["sun_envelope", "node"] == "T_e"
    assert model.network.parameter("g_i_out").spread < 1.0
    assert len(known) == 21
    model.save(tmp_path / "m.npz")
    loaded = tg.load(tmp_path / "m.npz")
    plan = {"u_heat": 500.0}
    assert bits(loaded.forecast(plan, "1h")) == bits(model.forecast(plan, "1h"))
    assert loaded.known_heat().equals(model.known_heat())
    # Saved before there was such heat, a model of the network that follows from the columns goes on without.
    without = tg.fit(table, "auto", habits=False, sun=False, **options)
    assert without.known_heat().empty
    assert as_saved_before(without, tmp_path, settings=("habits", "sun")).network.terms == ()


def test_a_model_saved_before_the_default_changed_goes_on_as_what_it_was(tmp_path):
    model = tg.fit(room(samples=10), "tite", estimator="rbpf")
    loaded = as_saved_before(model, tmp_path, settings=("estimator",))
    assert loaded.estimator == "rbpf"
    assert_same(loaded, model)


def test_a_saved_model_keeps_columns_units_zone_and_network(tmp_path):
    table = room().rename(columns={"T_i": "Room"}).tz_convert("Europe/Berlin").tz_localize(None)
    table["Heat"] = table.pop("u_heat") / 1000
    network = presets.network("tite").with_parameter("C_i", lower=2e5)
    model = tg.fit(
        table, network, tz="Europe/Berlin", columns={"T_i": "Room", "u_heat": ("Heat", "kW")}, levels=0.9, **FEW
    )
    model.save(tmp_path / "m.npz")
    loaded = tg.load(tmp_path / "m.npz")
    assert loaded.parameters().loc["C_i", "prior_lower"] == 2e5
    assert loaded.forecast({"Heat": 1.0}).equals(model.forecast({"u_heat": 1000.0}))
    assert "lower_0.9" in loaded.predictions


def test_no_other_file_is_taken_for_a_model(tmp_path, model):
    path = tmp_path / "m.npz"
    with pytest.raises(tg.DataError, match="there is no file"):
        tg.load(path)
    model.save(path)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    for spoilt in (b"PK nonsense", bytes(content)):
        path.write_bytes(spoilt)
        with pytest.raises(tg.DataError, match="no saved model, or it is damaged"):
            tg.load(path)


def test_a_model_that_cannot_be_written_leaves_nothing_behind(tmp_path, model, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for path in (tmp_path, "", ".", tmp_path / "nowhere" / "m.npz"):
        with pytest.raises(tg.DataError, match=r"cannot be written to .*; choose another file"):
            model.save(path)
    assert list(tmp_path.iterdir()) == []


def test_a_plan_can_be_written_in_many_ways(model):
    times = model.forecast(horizon="1h").index
    heat = [0.0, 500.0, 1000.0, 1500.0, 2000.0, 2500.0]
    expected = bits(model.forecast({"u_heat": heat}, "1h"))
    timed = pd.Series(heat, index=times[:-1])
    for plan in [
        {"u_heat": np.array(heat)},
        {"u_heat": pd.Series(heat)},
        {"u_heat": timed},
        {"u_heat": timed.tz_convert("Asia/Tokyo")},
        {"u_heat": timed.tz_localize(None)},
        pd.DataFrame({"u_heat": heat}),
        pd.DataFrame({"u_heat": timed}),
        pd.DataFrame({"u_heat": timed, "T_i": 20.0}).iloc[::-1],
    ]:
        assert bits(model.forecast(plan, "1h")) == expected
    constant = bits(model.forecast({"u_heat": 700, "T_out": 3}, "1h"))
    assert bits(model.forecast(pd.DataFrame({"u_heat": [700.0] * 6, "T_out": 3.0}), "1h")) == constant


def test_what_is_not_planned_is_held(model):
    times = model.forecast(horizon="1h").index
    held = bits(model.forecast(horizon="1h"))
    last = room().iloc[-1]
    assert bits(model.forecast({"u_heat": last["u_heat"], "T_out": last["T_out"]}, "1h")) == held
    assert bits(model.forecast({"T_out": last["T_out"]}, "1h")) == held
    sparse = pd.DataFrame({"u_heat": [900.0, 300.0]}, index=times[[0, 4]])
    assert bits(model.forecast(sparse, "1h")) == bits(model.forecast({"u_heat": [900.0] * 4 + [300.0] * 2}, "1h"))
    earlier = pd.DataFrame({"u_heat": [900.0, 300.0]}, index=[times[0] - model.period, times[4]])
    assert bits(model.forecast(earlier, "1h")) == bits(model.forecast(sparse, "1h"))
    late = pd.DataFrame({"u_heat": [300.0]}, index=times[[4]])
    steps = [last["u_heat"]] * 4 + [300.0] * 2
    assert bits(model.forecast(late, "1h")) == bits(model.forecast({"u_heat": steps}, "1h"))


def test_scenarios_are_the_paths_of_the_mixture_filter():
    model = tg.fit(room(), "tite", estimator="mkf", estimator_options={"particles": 32})
    paths = model.scenarios({"u_heat": 1000.0}, "3h", count=50)
    assert paths.shape == (19, 50)
    assert (paths.index == model.forecast({"u_heat": 1000.0}, "3h").index).all()
    with pytest.raises(tg.DataError, match="count must be a whole number"):
        model.scenarios(count=0)
    disturbance = model.disturbance.iloc[-1]
    assert disturbance["measurement_sd_T_i_lower"] <= disturbance["measurement_sd_T_i_upper"]


def test_scenarios_of_a_bank_are_those_of_its_whole_forecast():
    # The default members, with and without physics.
    model = tg.fit(room(samples=200), "tite")
    for plan in (None, {"u_heat": 1000.0}):
        paths, fan = model.scenarios(plan, "24h", count=1000), model.forecast(plan, "24h", levels=(0.9,))
        # The standard error of a quantile at .05 of as many normal numbers is .067 of their standard deviation.
        for name, level in (("lower_0.9", 0.05), ("median", 0.5), ("upper_0.9", 0.95)):
            assert ((paths.quantile(level, axis=1) - fan[name]).abs() / fan["sd"]).max() < 0.15, name
        steps = paths.diff().iloc[1:].abs().to_numpy()
        assert np.median(steps) < 0.2 * fan["sd"].median(), "a path goes on from where it is"


def test_what_the_model_does_not_know_is_listed_with_a_remedy():
    table = room(samples=600)
    with pytest.warns(UserWarning, match="the table: u_heat is 0 W all the time"):
        model = tg.fit(table.assign(u_heat=0.0), "tite", **FEW)
    found = model.findings
    assert list(found.columns) == ["finding", "subject", "sentence"]
    assert len(found) > 0
    assert "see model.findings" in repr(model)


def test_skill_has_one_row_for_every_horizon(model):
    found = model.skill()
    assert list(found.index) == ["1 step", "1h", "6h", "24h"]
    assert found.loc["1 step", "forecasts"] == 59
    residual = model.predictions["residual"].iloc[1:]
    assert found.loc["1 step", "rmse"] == pytest.approx(np.sqrt((residual**2).mean()), rel=1e-5)
    assert found.loc["1 step", "crps"] == pytest.approx(model.predictions["crps"].mean(), rel=1e-5)
    assert found.loc["24h", "forecasts"] == 0
    assert {"coverage", "skill_persistence", "skill_arx"} <= set(found.columns)
    hourly = tg.fit(room(period="1h"), "tite", **FEW)
    issued = model.skill(as_issued=True)
    assert list(issued.index) == ["1h", "6h", "24h"]
    assert issued.loc["6h", "crps"] > 0.0
    assert {"coverage", "width", "persistence_crps", "yesterday_crps"} <= set(issued.columns)
    assert list(hourly.skill(days=1).index) == ["1 step", "6h", "24h"]


def test_the_weights_of_a_bank():
    members = {"filter": {"estimator": "ekf"}, "box": {"estimator": "arx"}}
    weights = tg.fit(room(), "tite", estimator="bank", estimator_options={"members": members}).weights
    assert list(weights.index) == ["filter", "box"]
    assert weights.sum().to_numpy() == pytest.approx(1.0)
    assert len(tg.fit(room(samples=10), "tite", **FEW).weights) == 0


def test_a_room_with_two_thermometers_has_pairs_as_columns():
    model = tg.fit(room().assign(T_e=lambda table: table["T_i"] - 2.0), TWO_SENSORS, **FEW)
    assert ("T_e", "lower_0.95") in model.forecast(horizon="1h").columns
    assert model.predictions["T_e"]["residual"].abs().max() < 5.0
    assert model.predictions["T_i"].columns.tolist()[0] == "y"


def test_a_slow_fit_shows_its_progress(capsys, monkeypatch):
    tg.fit(room(samples=10), "tite", **FEW)
    assert "fit" not in capsys.readouterr().err
    monkeypatch.setattr("service.recordings.progress.SLOW", 0.0)
    model = tg.fit(room(samples=10), "tite", **FEW)
    assert "fit: " in capsys.readouterr().err
    model.update(room(samples=20), progress=False)
    assert capsys.readouterr().err == ""


def fit(change=lambda table: table, network="tite", **arguments):
    return lambda: tg.fit(change(room(samples=20)), network, **{**FEW, **arguments})


def with_text(table):
    return table.astype(object).assign(T_out=["4", "n/a", *table["T_out"].iloc[2:]])


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        *((fit(**arguments), sentence) for arguments, sentence in MISTAKES["fit"]),
        (fit(lambda t: t["T_i"]), "the table must be a pandas DataFrame, not a Series"),
        (fit(lambda t: t.rename_axis("at").reset_index()), r'not times; .* df.index = pd.to_datetime\(df."at".\)'),
        (fit(lambda t: t.set_index(pd.to_datetime(range(len(t)), unit="us", utc=True))), "the rows are .* apart"),
        (fit(lambda t: t.tz_localize(None)), 'the times of the table have no time zone; give tz, such as tz="Europe/'),
        (fit(lambda t: t.tz_localize(None), tz="Mars"), "tz: time zone 'Mars' is unknown; use an IANA name"),
        (fit(lambda t: t.iloc[:0]), "the table has no rows"),
        (fit(lambda t: t.set_index(t.index.where(t.index != t.index[3]))), r"row 3 of the table has no time \(NaT\)"),
        (
            fit(lambda t: t.rename(columns={"u_heat": "uheat"})),
            'no column "u_heat" for u_heat .W.; its columns are T_i, T_out, uheat; did you mean "uheat"',
        ),
        (fit(lambda t: pd.concat([t, t[["T_i"]]], axis=1)), 'has the column "T_i" more than once; rename all but one'),
        (fit(with_text), 'column "T_out" holds "n/a" at 2025-01-10 00:10:00.00:00, which is no number; convert'),
        (fit(lambda t: t.assign(T_out=np.nan)), "no row of the table could be used: no reading of T_out yet"),
        (fit(lambda t: t.iloc[:1]), "one row, from which no period follows; give period"),
        (fit(lambda t: t.iloc[[0, 1, 3, 7, 12]]), "the rows are 10min to 50min apart, from which no period follows"),
        (fit(columns={"u_heat": ("u_heat", "K")}), "columns.u_heat.unit: unit 'K' cannot be converted to W"),
        (fit(seed=np.int64(-1)), "seed: must be a whole number .*, not -1"),
        (lambda: tg.fit(SPRING.iloc[12:18], "tite", tz=BERLIN, period="10min", **FEW), "skips every time"),
    ],
)
def test_a_mistake_is_one_sentence(call, sentence):
    with pytest.raises(tg.ServiceError, match=sentence) as told:
        call()
    assert len(str(told.value).splitlines()) == 1


def test_numbers_of_numpy_are_numbers(tmp_path):
    own = {"period": 600, "seed": 3, "max_gap": 4, "hold_inputs": 3600, "levels": [0.5, 0.75]}
    numpy = {name: np.int64(value) for name, value in own.items() if name != "levels"}
    numpy |= {"max_gap": np.array(4), "levels": np.array([0.5, 0.75], dtype=np.float32)}

    def fitted(settings, whole, listed):
        network = {"preset": "tite", "parameters": {"C_i": {"value": whole(2_000_000)}}}
        columns = {"u_heat": {"scale": whole(2), "valid": listed([0, 5000])}}
        options = {"estimator": "mkf", "estimator_options": {"particles": whole(16)}}
        return tg.fit(room(), network, columns=columns, **options, **settings)

    model = fitted(own, int, list)
    fitted(numpy, np.int32, np.array).save(tmp_path / "m.npz")
    assert_same(tg.load(tmp_path / "m.npz"), model)
    hour = bits(model.forecast({"u_heat": 5.0}, "1h"))
    for number in (np.array(5.0), np.float32(5.0), np.int8(5), np.longdouble(5.0)):
        assert bits(model.forecast({"u_heat": number}, np.int64(3600))) == hour
    assert model.scenarios(horizon=np.float64(3600), count=np.int64(3)).shape == (7, 3)
    assert model.skill(np.int64(7)).equals(model.skill(7))
    assert model.parameters(pd.Series([0.5])).equals(model.parameters([0.5]))


@pytest.mark.parametrize(
    "levels", [None, ["a"], [None], [[0.5]], [], 0.9, "0.9", [True], [95], [np.nan], np.array(0.5)]
)
def test_levels_that_are_none_are_refused_in_one_sentence(levels, model):
    for call in (model.forecast, model.parameters, model.time_constants, model.heat_loss):
        with pytest.raises(tg.DataError, match="levels must be a list of numbers between 0 and 1"):
            call(levels=levels)


@pytest.mark.parametrize("days", [[7], "7", None, True, 2])
def test_days_that_are_not_scored_are_refused_in_one_sentence(days, model):
    with pytest.raises(tg.DataError, match="days must be one of 1, 7, 30, not"):
        model.skill(days)


@pytest.mark.parametrize(
    ("plan", "horizon", "sentence"),
    [
        *MISTAKES["forecast"],
        ({"u_heat": np.array("on")}, "1h", 'the plan\'s "u_heat" must be a number or one number for every step'),
        ({"u_heat": np.timedelta64(5, "s")}, "1h", 'the plan\'s "u_heat" must be a number'),
        ({"u_heat": np.complex128(5j)}, "1h", 'the plan\'s "u_heat" must be a number'),
        ({"u_heat": ["on"] * 6}, "1h", 'the plan: column "u_heat" holds "on" at 0, which is no number'),
        (room(samples=6)[["u_heat"]], "1h", 'the plan\'s "u_heat" has no value between 2025-01-10 10:00:00'),
    ],
)
def test_a_mistake_in_a_plan_is_one_sentence(plan, horizon, sentence, model):
    with pytest.raises(tg.DataError, match=sentence):
        model.forecast(plan, horizon)


def test_what_an_estimator_does_not_have_is_said(model):
    assert model.scenarios(count=3).shape == (145, 3)
    black_box = tg.fit(room(), "tite", estimator="arx")
    with pytest.raises(tg.DataError, match="the estimator arx has no parameters of a building"):
        black_box.parameters()
    with pytest.raises(tg.DataError, match="the estimator arx knows no physics and samples no futures"):
        black_box.scenarios()
    assert black_box.volatility.shape == (60, 0)


def test_a_meter_of_energy_becomes_power_and_is_not_planned(model):
    table = room()
    meter = table.drop(columns="u_heat").assign(meter=table["u_heat"].shift(fill_value=0.0).cumsum() / 6000.0)
    found = tg.fit(meter, "tite", columns={"u_heat": ("meter", "kWh")}, **FEW)
    np.testing.assert_allclose(found.predictions["mean"].iloc[:50], model.predictions["mean"].iloc[:50], atol=1e-6)
    with pytest.raises(tg.DataError, match='"meter", which counts energy; plan u_heat in W instead'):
        found.forecast({"meter": 1.0})


def test_it_is_imported_quickly_and_says_how_to_install_pandas(tmp_path):
    code = (
        "import os, sys, thermogate as tg\n"
        "print('numba' in sys.modules, 'pandas' in sys.modules, 'NUMBA_CACHE_DIR' in os.environ, 'fit' in dir(tg))\n"
        "sys.modules['pandas'] = None\n"
        "try:\n    tg.fit(None, 'tite')\nexcept ImportError as error:\n    print(error)\n"
        "import numba\nprint(numba.config.CACHE_DIR == os.environ['NUMBA_CACHE_DIR'])\n"
        "try:\n    tg.fitt\nexcept AttributeError as error:\n    print(error)"
    )
    assert python(code, XDG_CACHE_HOME=str(tmp_path), NUMBA_CACHE_DIR=None).splitlines() == [
        "False False False True",
        'pandas is not installed; install it with: pip install "thermogate[pandas]"',
        "True",
        "module 'thermogate' has no attribute 'fitt'",
    ]
