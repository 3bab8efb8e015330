"""`tg.load` of a state folder: what a daemon has learned of a zone, in a notebook."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.daemon_state import leave_state
from support.thermostat_house import recorded, table

import thermogate as tg
from service.config.load import load
from service.records.sample import Sample
from service.store.store import CHECKPOINTS, JOURNAL

PERIOD = 1800
OUTPUTS, INPUTS, SETPOINTS = recorded(4, PERIOD)
TABLE = table(4)
CUT = 3 * 48


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What a daemon leaves of the first days, with the newest checkpoint some samples before the end."""
    folder = tmp_path_factory.mktemp("state")
    config = load(Path(__file__).with_name("plant.toml"), [f'site.state_dir="{folder}"'])
    samples = (
        Sample.measured(int(when.timestamp()), OUTPUTS[row], INPUTS[row])._replace(setpoint=float(SETPOINTS[row]))
        for row, when in enumerate(TABLE.index[:CUT])
    )
    worker, _ = leave_state(config, samples, CUT - 10)
    return folder, worker


def test_a_model_of_a_daemon_is_where_the_daemon_is(folder):
    model = tg.load(folder[0], zone="office")
    latest = folder[1].latest.forecast.outputs[0]
    ahead = model.forecast(horizon="6h")
    assert ahead["mean"].iloc[0] == latest.mean
    assert str(ahead.index.tz) == "Europe/Berlin"
    assert ahead.index[0] == TABLE.index[CUT]
    assert model.heat_loss([0.5]).tolist() == folder[1].heat_loss([0.5])
    assert "144 samples in 1 segment, 2025-01-10 00:00 to 2025-01-12 23:30" in repr(model)
    assert len(model.predictions) == 9
    assert len(model.demand(horizon="3h")) > 0
    with pytest.raises(tg.ServiceError, match="to 7000 W can be planned"):
        model.forecast({"u_heat": 7001.0}, horizon="1h")


def test_it_goes_on_from_tables_and_is_saved_like_any_other(folder, tmp_path):
    before = {path: path.read_bytes() for path in folder[0].rglob("*") if path.is_file()}
    model = tg.load(folder[0]).update(TABLE.iloc[CUT - 5 :], progress=False)
    assert model.forecast(horizon="1h").index[0] == TABLE.index[-1] + pd.Timedelta("30min")
    model.save(tmp_path / "office.npz")
    again = tg.load(tmp_path / "office.npz")
    pd.testing.assert_frame_equal(again.forecast(horizon="6h"), model.forecast(horizon="6h"))
    assert repr(again) == repr(model)
    assert before == {path: path.read_bytes() for path in folder[0].rglob("*") if path in before}


def test_its_history_is_that_of_the_daemon(folder, tmp_path):
    pytest.importorskip("matplotlib")
    model = tg.load(folder[0])
    (history,) = model.plot("history").subfigs
    measured = next(line for line in history.axes[0].get_lines() if line.get_label() == "measured")
    np.testing.assert_allclose(measured.get_ydata(), TABLE["T_i"].iloc[:CUT])
    heat = history.axes[2].get_lines()[0].get_ydata()
    np.testing.assert_allclose(heat, TABLE["u_heat"].iloc[:CUT])
    report = model.report(tmp_path / "office.html").read_text()
    assert all(said in report for said in ("How is this room?", "for each m²"))


@pytest.mark.parametrize(
    ("spoil", "zone", "sentence"),
    [
        (lambda folder: None, "ofice", 'it has no zone "ofice"; choose one of office, such as zone="office"'),
        (lambda folder: (folder / "configuration.toml").unlink(), None, "there is no configuration.toml in"),
        (
            lambda folder: [path.unlink() for path in (folder / CHECKPOINTS).rglob("*.npz")],
            None,
            'has no checkpoint of zone "office" as it is configured; let the daemon run for a while',
        ),
    ],
)
def test_what_cannot_be_loaded_is_a_sentence(spoil, zone, sentence, folder, tmp_path):
    shutil.copytree(folder[0], tmp_path, ignore=shutil.ignore_patterns(f"{JOURNAL}-*"), dirs_exist_ok=True)
    spoil(tmp_path)
    with pytest.raises(tg.ServiceError, match=sentence) as told:
        tg.load(tmp_path, zone)
    assert len(str(told.value).splitlines()) == 1
