"""Forecasts scored as they were issued: with the inputs foreseen then, at their time, and nothing lost in between."""

import numpy as np
import pytest

from estimator.foresight import foreseen
from estimator.loop import ISSUED_DRAWS, Loop
from estimator.network.presets import network
from estimator.registry import build
from estimator.types import Mixture
from estimator.verification.as_issued import AsIssued
from estimator.verification.scores import crps
from estimator.verification.skill import IssuedScores

PERIOD = 1800
DAY = 48
LEADS = (2, 12, 48)
KINDS = {
    "ekf": {},
    "mkf": {"particles": 8},
    "bank": {"members": {"steady": {"estimator": "ekf"}, "arx": {"estimator": "arx"}}},
}


def loop_of(name="ekf", period=PERIOD):
    return Loop(build(name, network("tite"), period, KINDS[name]), 4, (0.95,))


def outdoors(k):
    return 5.0 + 4.0 * np.sin(2 * np.pi * k / DAY)


def lived(loop, steps, missing=(), heat=lambda k: 600.0 * (k % 5 < 2)):
    """What is carried after each of `steps`."""
    rng = np.random.default_rng(3)
    carried, kept = loop.begin(), []
    for k in range(steps):
        y = np.nan if k in missing else 20.0 + 0.3 * np.sin(k / 9) + 0.02 * rng.normal()
        carried = loop.step(carried, k * PERIOD, np.array([y]), np.array([outdoors(k), heat(k)]), k > 0).carried
        kept.append((carried, y))
    return kept


def scores(loop, carried, k, days=30):
    return loop.as_issued.scores(carried.standing.issued, k * PERIOD, days)


@pytest.mark.parametrize("name", ["ekf", "mkf"])
def test_the_scores_are_those_of_the_fans_that_were_issued(name):
    """A textbook version: keep every fan whole, and compare it with what came."""
    loop, steps = loop_of(name), 3 * DAY
    life = lived(loop, steps)
    sums = np.zeros((len(LEADS), len(IssuedScores._fields)))
    for k, (carried, _) in enumerate(life):
        if (k + 1) % 2 != 0:
            continue
        now, times = carried.held.values, (k + 1) * PERIOD + PERIOD * np.arange(DAY - 1.0)
        rows = foreseen(loop.estimator.network, carried.day, now, times).rows
        fan = loop.estimator.unfold(loop.estimator.issue(carried.standing.state, ISSUED_DRAWS), rows)
        for horizon, lead in enumerate(LEADS):
            if k + lead >= steps:
                continue
            y, last = life[k + lead][1], life[k][1]
            before = life[k + lead - DAY][1] if k + lead >= DAY else last
            mixture = fan.at(lead - 1)
            lower, upper = mixture.quantiles(np.array([0.5 - 0.95 / 2, 0.5 + 0.95 / 2]), 0)
            whole = Mixture(mixture.weights / mixture.weights.sum(), mixture.means, mixture.sds)
            error = y - whole.mean()[0]
            values = (1.0, error**2, crps(mixture, 0, y), lower <= y <= upper, upper - lower)
            sums[horizon] += [*values, (y - last) ** 2, (y - before) ** 2, abs(y - last), abs(y - before)]
    count, *means = sums.T
    expected = IssuedScores(count, *(column / count for column in means))
    found = scores(loop, life[-1][0], steps - 1)
    assert loop.as_issued.leads == tuple(PERIOD * lead for lead in LEADS)
    # One of an hour, six of six hours, and twenty-four of a day.
    assert len(life[-1][0].standing.issued.waiting.due) == 1 + 6 + 24
    for name, values, others in zip(found._fields, found, expected, strict=True):
        np.testing.assert_allclose(values, np.sqrt(others) if name.endswith("rmse") else others, rtol=1e-5)


def test_a_missing_measurement_is_no_error_and_a_gap_ends_what_was_waiting():
    loop = loop_of()
    whole = lived(loop, 40)
    some = lived(loop, 40, missing=(30, 31))
    assert scores(loop, some[-1][0], 39).forecasts[0] < scores(loop, whole[-1][0], 39).forecasts[0]
    carried = whole[-1][0]
    after = loop.step(carried, 60 * PERIOD, np.array([20.0]), np.array([5.0, 0.0]), False).carried
    assert len(carried.standing.issued.waiting.due)
    assert (after.standing.issued.waiting.due > 2).all()
    assert after.standing.issued.book.sums.sum() == carried.standing.issued.book.sums.sum()


def test_a_checkpoint_without_it_begins_empty():
    issued = loop_of().as_issued.unpack({})
    assert len(issued.waiting.due) == 0
    assert not issued.book.sums.any()


def test_heating_that_nobody_foresees_shows_here_and_not_in_hindsight():
    """The heat is on or off for half a day at a time; the published forecast holds it as it is."""
    loop = loop_of()
    estimator = loop.estimator
    carried, air = loop.begin(), 20.0
    for k in range(10 * DAY):
        heat = 3000.0 * (k % 24 < 12)
        carried = loop.step(carried, k * PERIOD, np.array([air]), np.array([5.0, heat]), k > 0).carried
        air += PERIOD / 20e6 * (heat - 100.0 * (air - 5.0))
    known = loop.verification.scores(carried.standing.verified, (10 * DAY - 1) * PERIOD, 7)
    published = loop.as_issued.scores(carried.standing.issued, (10 * DAY - 1) * PERIOD, 7)
    assert known.coverage[2] > 0.8
    assert published.coverage[1] < 0.5
    assert published.rmse[1] > 3.0 * known.rmse[2]
    assert estimator.network.inputs[1] == "u_heat"


@pytest.mark.parametrize(("hours", "leads"), [(1, (6, 24)), (6, (24,)), (24, ())])
def test_a_horizon_of_one_step_is_not_issued(hours, leads):
    """Its inputs are known, and the published forecast is scored as it is."""
    assert AsIssued(3600.0 * hours).leads == tuple(3600 * lead for lead in leads)
