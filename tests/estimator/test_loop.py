"""The loop of a zone: nothing that is carried is changed, and single steps are those of the whole loop."""

import copy

import numpy as np
import pytest

from estimator.loop import VANISHED_LIMIT, Loop
from estimator.network.presets import network
from estimator.registry import build

PERIOD = 600
KINDS = {
    "ekf": {},
    "rbpf": {"particles": 60},
    "mkf": {"particles": 8},
    "bank": {"members": {"steady": {"estimator": "ekf"}, "arx": {"estimator": "arx"}}},
}


def loop_of(name, **settings):
    return Loop(build(name, network("tite"), PERIOD, KINDS[name]), 5, (0.95, 0.5), **settings)


def taken(loop, carried, k, y=None, continues=True):
    outputs = np.array([20.0 + 0.3 * np.sin(k / 9) if y is None else y])
    return loop.step(carried, k * PERIOD, outputs, np.array([5.0, 600.0 * (k % 5 < 2)]), continues and k > 0)


def bits(part):
    """Every number in a nest of tuples, dictionaries and arrays."""
    if isinstance(part, np.ndarray):
        return part.tobytes()
    if isinstance(part, tuple | list):
        return tuple(map(bits, part))
    return tuple((name, bits(value)) for name, value in part.items()) if isinstance(part, dict) else repr(part)


@pytest.mark.parametrize("name", KINDS)
def test_a_step_changes_nothing_of_what_it_is_given(name):
    loop = loop_of(name)
    carried = loop.begin()
    for k in range(40):
        before = copy.deepcopy(carried)
        step = taken(loop, carried, k)
        again = taken(loop, carried, k)
        assert bits(carried) == bits(before)
        assert bits(again.carried) == bits(step.carried)
        carried = step.carried


@pytest.mark.parametrize("name", KINDS)
def test_single_steps_are_those_of_the_whole_loop(name):
    whole, single = loop_of(name), loop_of(name, single_steps=True)
    left, right = whole.begin(), single.begin()
    for k in range(60):
        y = 60.0 if 40 <= k < 40 + VANISHED_LIMIT + 2 else None
        one, other = taken(whole, left, k, y, k != 20), taken(single, right, k, y, k != 20)
        left, right = one.carried, other.carried
        assert bits(left.standing.forecast) == bits(right.standing.forecast)
        assert (one.started, left.vanished) == (other.started, right.vanished)
    assert right.standing.verified is None


def test_in_a_long_history_live_forecasts_are_seldom_made_until_its_last_weeks():
    loop, hours, weeks = loop_of("ekf"), 6, 5
    steps = 14 * 24 * hours
    loop.history_end = steps * PERIOD + weeks * 7 * 86400 - 3 * 86400
    carried, made, latest = loop.begin(), [], 0
    for k in range(steps):
        carried = taken(loop, carried, k).carried
        newest = carried.standing.issued.waiting.due.max(initial=0)
        if newest > latest:
            made.append((k + 1) * PERIOD // 3600)
            latest = newest
    seldom, hourly = (np.diff([hour for hour in made if (hour < 11 * 24) is early]) for early in (True, False))
    assert (set(seldom), set(hourly)) == ({7}, {1})
    assert len({hour % 24 for hour in made if hour < 11 * 24}) == 24
