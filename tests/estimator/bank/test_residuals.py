"""Corrections of members with physics: what returns by the hour is learned, noise is not, and heating plays no part."""

import numpy as np
import pytest

from estimator.bank.residuals import Corrector
from estimator.heat.terms import HABIT_HOURS, with_known_heat
from estimator.network.presets import network
from estimator.types import Mixture
from estimator.verification.hindsight import Due

PERIOD, LEADS = 1800.0, (1, 2, 12, 48)
NETWORK = with_known_heat(network("tite"), habits=True)
DAYS = 20


def drive_of(steps):
    """Rows (K, n) of a winter, with the hats of the hour at which each interval begins."""
    hours = steps * PERIOD / 3600.0
    rows = np.zeros((len(steps), len(NETWORK.drive)))
    rows[:, NETWORK.drive.index("T_out")] = 5.0 + 3.0 * np.sin(2.0 * np.pi * hours / 24.0)
    for hour in HABIT_HOURS:
        apart = np.abs(hours % 24.0 - hour)
        hat = np.maximum(1.0 - np.minimum(apart, 24.0 - apart) / 3.0, 0.0)
        rows[:, NETWORK.drive.index(f"habit_{hour:02}")] = hat
    return rows


def corrected(errors, corrector=None):
    """What `corrector` has learned, and the mean (K, 2) 6 h ahead of a member that always forecasts 20 degC, and of one
    that is not corrected, where what comes is off by `errors` (K,)."""
    corrector = corrector or Corrector(NETWORK, PERIOD, LEADS, [1])
    drive, means = drive_of(np.arange(len(errors))), np.full((len(errors), 2), np.nan)
    known, told = corrector.start(np.array([20.0])), Mixture(np.ones(1), np.array([[20.0]]), np.array([[0.3]]))
    due = [Due(n, lead, (told, told), np.empty(0), ()) for n, lead in enumerate(LEADS) if lead > 1]
    for step in range(50, len(errors)):
        hourly = due if step % 2 == 0 else []
        known = corrector.predict(known)
        known, judged = corrector.judged(known, hourly, drive[: step + 1], np.array([20.0 + errors[step]]))
        if judged:
            means[step] = [mixture.mean()[0] for mixture in judged[-2].mixtures]
    return known, means


def test_an_error_that_returns_at_its_hour_is_corrected_once_corrections_have_come_true():
    errors = 0.8 * np.sin(2.0 * np.pi * np.arange(DAYS * 48) / 48.0)
    _, means = corrected(errors)
    left, late = means[:, 1] - 20.0 - errors, slice(-5 * 48, None)
    assert (means[50:96:2] == 20.0).all()
    assert (means[50::2, 0] == 20.0).all()
    assert np.nanstd(left[late]) < 0.3 * errors.std()


def test_noise_is_hardly_corrected():
    _, means = corrected(np.random.default_rng(1).normal(0.0, 0.8, DAYS * 48))
    assert np.nanstd(means[:, 1]) < 0.2


def test_no_heating_to_come_changes_a_correction_and_none_is_larger_than_an_error_was():
    corrector = Corrector(NETWORK, PERIOD, LEADS, [1])
    known, _ = corrected(0.8 * np.sin(2.0 * np.pi * np.arange(DAYS * 48) / 48.0), corrector)
    known = corrector.predict(known)
    plan = drive_of(np.arange(DAYS * 48, DAYS * 48 + 96))
    made = corrector.corrections(known, plan, np.arange(1, 97))
    assert np.ptp(made) > 0.5
    heated = plan.copy()
    heated[:, NETWORK.drive.index("u_heat")] = 5000.0
    np.testing.assert_array_equal(corrector.corrections(known, heated, np.arange(1, 97)), made)
    frozen = plan.copy()
    frozen[:, NETWORK.drive.index("T_out")] = -500.0
    assert np.abs(corrector.corrections(known, frozen, np.arange(1, 97))).max() <= known.largest.max()
    again = corrector.restart(known, np.array([21.0]))
    assert (again.outputs == 21.0).all()
    assert again.moments == pytest.approx(known.moments)
