"""Set-points in a notebook: planned, and the answers that the thermostat's law gives."""

import pandas as pd
import pytest
from support.tables import tabled
from support.thermostat_house import table

import thermogate as tg
from service.records.trust import HorizonTrust, Trust

HOUSE = table(6)
TABLE = HOUSE.drop(columns="T_set").assign(**{"Set F": HOUSE["T_set"] * 1.8 + 32.0})


def fitted(measured=TABLE, **columns):
    return tg.fit(measured, "tite", estimator="ekf", columns=columns, progress=False)


@pytest.fixture(scope="module")
def model():
    return fitted(T_set=("Set F", "degF"))


def test_set_points_are_planned_by_channel_or_column(model):
    assert model.forecast({"Set F": 69.8}, "3h").equals(model.forecast({"T_set": 21.0}, "3h"))
    assert model.forecast({"T_set": 21.0})["mean"].iloc[-1] == pytest.approx(21.0, abs=0.8)


def test_a_column_of_that_name_is_the_set_point():
    with pytest.raises(tg.DataError, match="the model cannot say: no law of the thermostat is known"):
        fitted(TABLE.iloc[:24].assign(T_set=HOUSE["T_set"])).demand()


def test_the_set_point_is_saved_with_the_model(model, tmp_path):
    model.save(tmp_path / "m.npz")
    pd.testing.assert_frame_equal(tg.load(tmp_path / "m.npz").demand(horizon="3h"), model.demand(horizon="3h"))


def test_the_law_is_told_with_intervals(model):
    (law,) = model.thermostat.reset_index().to_dict("records")
    assert (law["channel"], law["side"], law["law"]) == ("u_heat", "heating", "proportional")
    assert law["power_lower"] < law["power_mean"] < law["power_upper"]
    assert law["band_mean"] == pytest.approx(1.5, abs=0.3)
    assert fitted(TABLE.iloc[:24]).thermostat.empty


def test_preheat_demand_and_comparison(model):
    start = model.preheat(20.5, "06:30")
    assert start["issue_time"] == pd.Timestamp("2025-01-16", tz="Europe/Berlin") < start["start"]
    assert start["by"] - start["start"] == pd.Timedelta(minutes=start["minutes"])
    assert start["reached"] >= 0.9
    assert start.equals(model.preheat(20.5, pd.Timestamp("2025-01-16 06:30")))
    hours = model.demand({"T_set": [20.0] * 12}, "6h")
    assert hours.index[-1] == pd.Timestamp("2025-01-16 05:00", tz="Europe/Berlin")
    total = model.demand({"T_set": 20.0}, "6h", hourly=False)
    assert total["mean"] == pytest.approx(hours["mean"].sum(), rel=1e-6)
    assert total["lower"] < total["mean"] < total["upper"]
    plans = model.compare({"warm": {"T_set": 21.0}, "cool": {"T_set": 18.0}}, "6h", price=0.3)
    assert plans.loc["warm", "energy_difference"].tolist() == [0.0] * 3
    assert plans.loc["cool", ("energy_difference", "upper")] < 0.0
    assert plans.loc["cool", ("cost", "mean")] == pytest.approx(0.3 * plans.loc["cool", ("energy", "mean")])


@tabled
def test_what_cannot_be_answered_is_refused_in_a_sentence(model, ask, given, settings, sentence):
    with pytest.raises(tg.ServiceError, match=sentence):
        getattr(model, ask)(*given, **settings)


def test_a_set_point_in_watts_is_refused():
    with pytest.raises(tg.ServiceError, match=r"columns\.T_set: unit 'W' cannot be converted to degC"):
        fitted(T_set=("Set F", "W"))


def test_a_model_that_is_not_trusted_refuses(model, monkeypatch):
    told = Trust(0, (HorizonTrust(86400, "untrusted", "its forecasts were worse than persistence", 0),))
    monkeypatch.setattr(model._session.worker, "trust", told)
    with pytest.raises(tg.DataError, match="the model is not trusted 24 h ahead: its forecasts were worse"):
        model.demand()
