"""Diagnostics of residuals whose structure is known."""

import numpy as np
import pytest
from support.fake_zones import skill_over

from estimator.diagnosis.finding import Diagnosis
from estimator.network import presets
from replay.recorded.trace import Trace
from replay.reports.advice import advice
from replay.reports.residuals import correlation, diagnostics
from service.records.history import HistoryRow
from service.records.skill import HorizonSkill

PERIOD, NAN = 600, float("nan")


def trace(
    residual, inputs=None, *, sd=0.1, half=0.2, times=None, options=None, horizons=(), findings=(), estimator="rbpf"
):
    """A zone whose forecasts of 20 degC missed by `residual`."""
    count = len(residual)
    times = PERIOD * np.arange(count) if times is None else times
    rows = [
        HistoryRow(int(t), 20 + e, 20.0, 20 - half, 20 + half, sd, e, *(NAN,) * 4, 1.0, NAN, False, 0.0, 1, *(NAN,) * 4)
        for t, e in zip(times, residual, strict=True)
    ]
    network = presets.network("tite")
    skill = skill_over(int(times[-1]), {1: (), 30: tuple(horizons)})
    return Trace(
        zone="z",
        network=network,
        estimator=estimator,
        period=PERIOD,
        level=0.95,
        options=options or {},
        rows=rows,
        inputs=np.zeros((count, 2)) if inputs is None else inputs,
        looks=np.empty(0, dtype=np.int64),
        parameters=np.empty((0, 4, 3)),
        heat_loss=np.empty((0, 3)),
        fans=[],
        skill=skill,
        diagnosis=Diagnosis(tuple(findings)),
        faults={},
    )


def white(count=4000, sd=0.1, seed=1):
    return sd * np.random.default_rng(seed).standard_normal(count)


def test_white_residuals_show_nothing():
    found = diagnostics(trace(white()))
    assert np.histogram(found.pit, bins=4, range=(0, 1))[0] == pytest.approx([1000] * 4, abs=110)  # four sd
    assert found.band == pytest.approx(1.96 / np.sqrt(4000))
    assert (np.abs(found.autocorrelation) < 4 / np.sqrt(4000)).all()
    assert (found.lags[0], found.lags[-1]) == (600, 21600)
    assert np.isnan(found.against_inputs["u_heat"]).all(), "an input that never varies says nothing"


def test_the_memory_of_an_error_is_seen():
    noise, errors = white(), np.zeros(4000)
    for k in range(1, 4000):
        errors[k] = 0.7 * errors[k - 1] + noise[k]
    assert diagnostics(trace(errors)).autocorrelation[:3] == pytest.approx([0.7, 0.49, 0.343], abs=0.09)


def test_an_input_is_seen_at_its_lag():
    heat = (white(2000, 1.0, 2) > 0) * 1000.0
    inputs = np.column_stack([white(2000, 1.0, 3), heat])
    errors = white(2000)
    errors[4:] += 0.0005 * heat[:-4]  # in force from sample k - 4, so three steps before the last one
    found = diagnostics(trace(errors, inputs))
    assert int(np.nanargmax(np.abs(found.against_inputs["u_heat"]))) == 3
    assert found.against_inputs["u_heat"][3] > 0.8
    assert np.abs(found.against_inputs["T_out"]).max() < 4.5 / np.sqrt(2000)


def test_nothing_is_compared_across_a_gap():
    times = PERIOD * np.array([0, 1, 2, 100, 101, 102])
    errors = np.array([1.0, 2.0, 3.0, -3.0, -2.0, -1.0])
    expected = np.corrcoef([2, 3, -2, -1], [1, 2, -3, -2])[0, 1]
    assert diagnostics(trace(errors, times=times)).autocorrelation[0] == pytest.approx(expected)
    assert np.isnan(correlation(errors, errors, 6))


def horizon(lead, rmse, persistence=1.0, arx=1.0, forecasts=500):
    return HorizonSkill.of(lead, forecasts, 0.95, 0.1, rmse, 1.0, persistence, arx)


def said(period):
    return advice(period, diagnostics(period))


def test_a_sound_zone_is_told_nothing():
    assert said(trace(white(), horizons=[horizon(600, 0.5), horizon(3600, 0.9)])) == [
        "Nothing: there is no finding, and forecasts and intervals are what they should be."
    ]


def test_horizons_that_are_worse_than_simple_forecasts_are_named():
    worse = [horizon(600, 0.9), horizon(3600, 1.2), horizon(21600, 1.5, arx=2.0), horizon(86400, 9.0, forecasts=5)]
    changes, regression = said(trace(white(), horizons=worse))
    assert "at 1 h (20 %) and 6 h (50 %)" in changes
    assert "24 h" not in changes, "five forecasts say nothing"
    assert "thermogate experiment topology" in changes
    assert 'at 1 h (20 %); set `estimator = "bank"`' in regression
    assert len(said(trace(white(), horizons=worse, estimator="bank"))) == 1


def test_intervals_that_do_not_fit_name_the_option():
    (wide,) = said(trace(white(sd=0.02), half=0.4, options={"measurement_sd": 0.15}))
    assert "100.0 % of the 95 % intervals" in wide
    assert "`measurement_sd = 0.15` K is more than the whole error" in wide
    assert "at most 0.02" in wide
    (narrow,) = said(trace(white(), half=0.1, options={"process_sd": 0.01}))
    assert "too narrow; raise `process_sd` (now 0.01 K per step)" in narrow
    (other,) = said(trace(white(), half=0.1, options={}, estimator="arx"))
    assert 'set `estimator = "bank"`' in other


def test_residuals_with_structure_name_the_network_and_the_input():
    heat = np.repeat(white(40, 1.0, 2) > 0, 50) * 1000.0
    errors = white(2000, 0.05) + 0.0002 * (heat - heat.mean())
    sentences = said(trace(errors, np.column_stack([white(2000, 1.0, 3), heat]), half=0.3))
    assert any("An error of one step predicts the next" in sentence for sentence in sentences)
    assert any("The errors follow `u_heat`" in sentence for sentence in sentences)
    assert not any("`T_out`" in sentence for sentence in sentences)
