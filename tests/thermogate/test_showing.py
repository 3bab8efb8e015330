"""What a model shows of itself: predictions as scikit-learn's users expect them, figures, a report, HTML."""

import re
import sys

import numpy as np
import pandas as pd
import pytest
from support.saved_models import as_saved_before
from support.thermostat_house import table

import thermogate as tg

pytest.importorskip("matplotlib")

TABLE = table(6)


def fitted(measured=TABLE, **settings):
    own = {"estimator": "mkf", "estimator_options": {"particles": 16}}
    return tg.fit(measured, "tite", progress=False, **{**own, **settings})


@pytest.fixture(scope="module")
def model():
    return fitted()


@pytest.fixture(scope="module")
def loaded(model, tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "m.npz"
    model.save(path)
    return tg.load(path)


def test_a_prediction_has_the_times_of_its_inputs_and_a_column_for_each_quantile(model):
    fan = model.forecast({"u_heat": 800.0}, "6h", levels=(0.5, 0.95))
    asked = pd.DataFrame({"u_heat": 800.0, "unused": 1.0}, index=fan.index).drop(columns="unused")
    found = model.predict(asked, (0.025, 0.25, 0.5, 0.975))
    assert list(found.columns) == ["q0.025", "q0.25", "q0.5", "q0.975"]
    pairs = {"q0.025": "lower_0.95", "q0.25": "lower_0.5", "q0.5": "median", "q0.975": "upper_0.95"}
    for own, theirs in pairs.items():
        np.testing.assert_allclose(found[own], fan[theirs], rtol=1e-12)
    some = fan.index[[5, 2]]
    pd.testing.assert_frame_equal(model.predict(asked, [0.5]).loc[some], model.predict(asked.iloc[:6], [0.5]).loc[some])
    assert model.predict(some.tz_convert("UTC"), [0.5]).index.equals(some.tz_convert("UTC"))
    assert len(model.predict()) == 49


@pytest.mark.parametrize(
    ("times", "sentence"),
    [
        (TABLE.index[-2:], "no forecast's; forecasts are for 2025-01-16 00:00:00.*model.predictions"),
        (TABLE.index[-1:] + pd.Timedelta("35min"), "no forecast's"),
        (pd.Index([1, 2]), "the index of X holds int64, not times"),
    ],
)
def test_times_without_a_forecast_are_refused(times, sentence, model):
    with pytest.raises(tg.DataError, match=sentence):
        model.predict(times)


def axes_of(figure):
    return [axes for part in figure.subfigs for axes in part.axes]


def test_the_figure_of_everything_has_labelled_axes(model):
    figure = model.plot()
    assert [part.get_suptitle() for part in figure.subfigs] == [
        "Forecast",
        "History",
        "Heat besides the heating",
        "Parameters",
    ]
    labels = [(axes.get_xlabel(), axes.get_ylabel()) for axes in axes_of(figure)]
    assert labels == [
        ("time (Europe/Berlin)", "T_i [°C]"),
        ("", "T_i [°C]"),
        ("", "[°C]"),
        ("time (Europe/Berlin)", "[W]"),
        ("hour of the day (Europe/Berlin)", "heat besides the heating [W]"),
        ("95 % interval between the prior's bounds, logarithmic", ""),
    ]
    assert figure._repr_png_().startswith(b"\x89PNG")


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_the_forecast_is_drawn_under_its_plan_after_what_was_measured(model):
    (axes,) = axes_of(model.plot("forecast", plan={"T_set": 15.0}, horizon="12h"))
    drawn = lines(axes)
    expected = model.forecast({"T_set": 15.0}, "12h")["median"]
    np.testing.assert_allclose(drawn["forecast"].get_ydata(), expected)
    np.testing.assert_allclose(drawn["measured"].get_ydata(), TABLE["T_i"].iloc[-len(expected) :])
    assert set(drawn) == {"forecast", "measured", "set-point"}
    assert len(axes.collections) == 2


def test_the_history_has_every_sample_and_input(model):
    temperature, outside, heat = axes_of(model.plot("history"))
    np.testing.assert_allclose(lines(temperature)["measured"].get_ydata(), TABLE["T_i"])
    np.testing.assert_allclose(lines(outside)["T_out"].get_ydata(), TABLE["T_out"])
    np.testing.assert_allclose(lines(heat)["u_heat"].get_ydata(), TABLE["u_heat"])
    low, high = temperature.get_ylim()
    assert low < TABLE["T_i"].quantile(0.01) < TABLE["T_i"].quantile(0.99) < high


def test_parameters_stand_between_the_bounds_of_their_priors(model):
    (axes,) = axes_of(model.plot("parameters"))
    known = model.parameters()
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert sorted(names) == sorted(f"{name} [{row.unit}]" for name, row in known.iterrows() if row.free)
    (middle,) = axes.get_lines()[:1]
    assert ((middle.get_xdata() > 0) & (middle.get_xdata() < 1)).all()


def test_what_a_model_does_not_have_is_not_drawn():
    black_box = fitted(TABLE.iloc[:60].drop(columns="T_set"), estimator="arx", estimator_options={})
    assert [part.get_suptitle() for part in black_box.plot().subfigs] == ["Forecast", "History"]
    for what, sentence in (
        ("parameters", "the estimator arx has no parameters of a building"),
        ("profile", "the estimator arx knows of no heat besides the heating; fit with bank or mkf"),
        ("forcast", 'what is forecast, history, profile or parameters, not "forcast"'),
    ):
        with pytest.raises(tg.DataError, match=sentence):
            black_box.plot(what)


def test_without_matplotlib_one_sentence_says_how_to_install_it(model, monkeypatch):
    from thermogate import plots

    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    plots._figure_class.cache_clear()
    with pytest.raises(ImportError, match=r'install it with: pip install "thermogate\[pandas,plot\]"'):
        model.plot()


def test_a_report_is_the_page_of_a_replay_and_survives_saving(model, loaded, tmp_path):
    text = model.report(tmp_path / "office.html").read_text()
    assert re.findall(r"<h2>(.*?)</h2>", text)[:2] == ["How is this room?", "Forecasts"]
    assert "Thermogate report: office" in text
    assert len(re.findall(r"class='plot'", text)) >= 6
    assert loaded.report(tmp_path / "office.html").read_text() == text
    assert "<html lang='de'>" in model.report(tmp_path / "raum.html", language="de").read_text()


def test_a_report_that_cannot_be_made_is_refused_in_one_sentence(model, tmp_path):
    with pytest.raises(tg.DataError, match="language is en or de, not"):
        model.report(tmp_path / "room.html", language="fr")
    with pytest.raises(tg.DataError, match=r"the report cannot be written to .*No such file.*another file"):
        model.report(tmp_path / "missing" / "room.html")


def test_a_model_saved_before_there_were_reports_says_so(model, tmp_path):
    old = as_saved_before(model, tmp_path, arrays=("trace.",))
    assert old.predictions.equals(model.predictions)
    with pytest.raises(tg.DataError, match="kept no history in it; fit it again"):
        old.report(tmp_path / "room.html")
    assert "<pre>" in old._repr_html_()


def test_a_notebook_shows_the_answers_before_the_scores(model, loaded):
    html = model._repr_html_()
    assert html == loaded._repr_html_()
    assert "Thermogate model: network tite, estimator mkf" in html
    assert html.index("It loses") < html.index("<table")
    assert "<th>24h</th>" in html
