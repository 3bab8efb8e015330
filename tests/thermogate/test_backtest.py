"""`tg.backtest` and `tg.compare`: the scores of forecasts along a table."""

import numpy as np
import pandas as pd
import pytest
from support.thermostat_house import table

import thermogate as tg

TABLE = table(6).drop(columns="T_set").rename(columns={"T_i": "Room"})
COLUMNS = {"T_i": "Room"}


@pytest.fixture(scope="module")
def found():
    return tg.compare(TABLE, ["ekf", "arx"], "tite", columns=COLUMNS)


def test_every_estimator_has_scores_at_every_horizon_beside_persistence(found):
    scores = found.scores
    assert list(scores.index.get_level_values("estimator").unique()) == ["persistence", "ekf", "arx"]
    assert list(scores.loc["ekf"].index) == ["1 step", "1h", "6h", "24h"]
    assert (scores.loc["persistence", "skill_persistence"] == 0.0).all()
    # A heated room whose thermostat sets it back every night does not stay as it is.
    assert scores.loc[("ekf", "6h"), "skill_persistence"] > 0.2
    assert 0.5 < scores.loc[("ekf", "6h"), "coverage"] <= 1.0
    assert found.first_days.loc[("ekf", "1 step"), "forecasts"] == 3 * 48 - 1


def test_the_scores_are_those_of_the_forecasts(found):
    ahead = found.forecasts("ekf", "6h")
    later = ahead[ahead.index >= TABLE.index[3 * 48 + 12]]
    row = found.scores.loc[("ekf", "6h")]
    assert row["forecasts"] == len(later)
    assert row["rmse"] == pytest.approx(np.sqrt(((later["mean"] - later["y"]) ** 2).mean()))
    assert row["crps"] == pytest.approx(later["crps"].mean())
    inside = (later["lower_0.95"] <= later["y"]) & (later["y"] <= later["upper_0.95"])
    assert row["coverage"] == pytest.approx(inside.mean())
    assert later["y"].equals(TABLE["Room"].loc[later.index].rename("y"))


@pytest.mark.filterwarnings("ignore:the table. T_i")
def test_nothing_has_a_skill_against_a_persistence_that_was_right():
    still = tg.compare(TABLE.iloc[:192].assign(Room=20.0), "arx", "tite", columns=COLUMNS)
    assert still.scores["skill_persistence"].isna().all()


def test_a_forecast_one_step_ahead_is_the_one_of_the_model(found):
    own = tg.fit(TABLE, "tite", columns=COLUMNS, estimator="ekf").predictions
    ahead = found.forecasts("ekf", "1 step")
    np.testing.assert_allclose(ahead["mean"], own["mean"].loc[ahead.index], rtol=1e-12)


@pytest.mark.filterwarnings("ignore:the table. T_i varies")
def test_a_forecast_knows_nothing_of_what_comes_after_it():
    cut = 4 * 48
    early = tg.backtest(TABLE.iloc[:cut], "tite", columns=COLUMNS, estimator="ekf")
    other = TABLE.assign(Room=TABLE["Room"].where(np.arange(len(TABLE)) < cut, 5.0))
    late = tg.backtest(other, "tite", columns=COLUMNS, estimator="ekf")
    for horizon in ("1h", "24h"):
        before = early.forecasts(horizon=horizon)
        pd.testing.assert_frame_equal(late.forecasts(horizon=horizon).loc[before.index], before, check_freq=False)


def test_a_backtest_has_the_rules_of_thumb_beside_it_and_shows_itself():
    found = tg.backtest(TABLE.iloc[: 4 * 48], "tite", columns=COLUMNS, estimator="arx")
    names = ["persistence", "yesterday", "arx"]
    assert list(found.scores.index.get_level_values("estimator").unique()) == names
    assert repr(found).startswith("Backtest after `first_days`")
    assert "skill_persistence" in repr(found)
    html = found._repr_html_()
    assert html.count("<table") == 1
    assert all(name in html for name in names)


def test_options_are_written_after_the_name_or_given_as_in_fit():
    day = TABLE.iloc[:48]
    seeds = [tg.backtest(day, "tite", columns=COLUMNS, estimator="mkf", estimator_options={"particles": 8}, seed=3)]
    seeds.append(tg.compare(day, "mkf:particles=8", "tite", columns=COLUMNS, seed=3))
    one, other = (found.forecasts(horizon="1h") for found in seeds)
    pd.testing.assert_frame_equal(one, other)


def compared(*estimators):
    return lambda: tg.compare(TABLE, [*estimators], "tite", columns=COLUMNS)


def backtested(table=TABLE, **settings):
    return lambda: tg.backtest(table, "tite", **{"columns": COLUMNS, **settings})


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (compared("kalman"), "estimators: kalman: there is no 'kalman'; the"),
        (compared("mkf:particles=-1"), "estimators: mkf:particles=-1: .*particles"),
        (backtested(columns={}), 'no column "T_i" for T_i'),
        (backtested(colour=1), "colour: is not a known key"),
        (backtested(TABLE.iloc[:1], period="30min"), "no two usable samples in a row"),
    ],
)
def test_a_mistake_is_one_sentence(call, sentence):
    with pytest.raises(tg.ServiceError, match=sentence) as told:
        call()
    assert len(str(told.value).splitlines()) == 1


def test_forecasts_that_were_not_made_are_refused_with_those_that_were(found):
    with pytest.raises(tg.DataError, match="no forecasts 2h ahead by ekf; the estimators are persistence, ekf, "):
        found.forecasts("ekf", "2h")
