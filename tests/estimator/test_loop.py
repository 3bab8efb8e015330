"""The loop of a zone: nothing that is carried is changed, and single steps are those of the whole loop."""

import copy

import numpy as np
import pytest

from estimator import loop as loops
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


def taken(loop, carried, k, y=None, continues=True, setpoint=np.nan):
    outputs = np.array([20.0 + 0.3 * np.sin(k / 9) if y is None else y])
    return loop.step(carried, k * PERIOD, outputs, np.array([5.0, 600.0 * (k % 5 < 2)]), continues and k > 0, setpoint)


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


def test_in_a_long_history_live_forecasts_are_the_more_seldom_the_longer_ago(monkeypatch):
    monkeypatch.setattr(loops, "_LAST_WEEKS", 6 * 86400)
    monkeypatch.setattr(loops, "_LAST_WEEK", 2 * 86400)
    loop, steps = loop_of("ekf"), 10 * 24 * 6
    loop.history_end = steps * PERIOD
    carried, made, stands = loop.begin(), [], []
    for k in range(steps):
        carried = taken(loop, carried, k, setpoint=20.0).carried
        issue = carried.live.issues[-1] if carried.live.issues else None
        if issue is not None and int(issue.step) == carried.live.step:
            made.append((k + 1) * PERIOD // 3600)
            stands.append(float(issue.stands))
    days = np.array(made) / 24
    for begin, end, apart in ((1, 4, 23), (4, 8, 5), (8, 10, 1)):
        within = (days >= begin) & (days < end)
        assert set(np.diff(np.array(made)[within])) == {apart}
        # It stands for those of every hour until the next one.
        assert set(np.array(stands)[within]) == {apart}
