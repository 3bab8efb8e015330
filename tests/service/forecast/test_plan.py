"""The grammar of plans."""

from typing import Any

import numpy as np
import pytest

from estimator.network.presets import network
from service.errors import PlanError
from service.forecast.plan import Grid, Plan, Stepped, Timed, check, column

GRID = Grid(start=1000.0, period=100.0, steps=6)
NAN = float("nan")


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (7, [7.0] * 6),
        (np.arange(6.0), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]),
        (Stepped(200.0, np.array([1.0, 2.0, 3.0])), [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]),
        # The last step may reach beyond the horizon.
        (Stepped(400.0, np.array([1.0, 2.0])), [1.0] * 4 + [2.0] * 2),
        (Timed(np.array([0.0, 1200.0]), np.array([0.1, 0.7])), [0.1] * 2 + [0.7] * 4),
        # Nothing is planned before the first time, and a value that changes within a period counts for its share.
        (Timed(np.array([1250.0, 1425.0]), np.array([0.0, 8.0])), [NAN, NAN, 0.0, 0.0, 6.0, 8.0]),
        (Timed(np.array([9000.0]), np.array([1.0])), [NAN] * 6),
    ],
)
def test_a_plan_has_a_value_for_every_period(values: Any, expected: list[float]) -> None:
    np.testing.assert_array_equal(column(values, GRID), expected)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (np.zeros(5), "has 5 values, but the horizon has 6 steps of 100s; give 6 values, or one number for all"),
        (Stepped(150.0, np.zeros(4)), "has the step 150s, which is not a whole number of the zone's periods of 100s"),
        (Stepped(200.0, np.zeros(4)), "has 4 values of 200s; the horizon takes 3 of them"),
        (Timed(np.array([2.0, 2.0]), np.zeros(2)), "has times that do not increase; put every time once, in order"),
        (-1.0, "plans -1 W; 0 to 2000 W can be planned, by valid, installed and nominal of the channel"),
        (np.array([0.0] * 5 + [2001.0]), "plans 2001 W"),
        (float("inf"), "plans inf W"),
    ],
)
def test_values_that_cannot_be_planned_are_one_sentence(values: Any, sentence: str) -> None:
    with pytest.raises(PlanError) as raised:
        check(values, "u_heat", network("titeth"), {"u_heat": (0.0, 2000.0)}, GRID)
    assert str(raised.value).startswith(sentence)


def test_what_is_planned_for_a_zone_goes_before_what_is_planned_for_all() -> None:
    plan = Plan(inputs={"*": {"u_heat": 1.0, "T_out": 5.0, "I_sol": 0.0}, "own": {"u_heat": 2.0}})
    assert plan.of("own", network("titeth").inputs) == {"u_heat": ("own", 2.0), "T_out": ("*", 5.0)}
    assert plan.of("other", network("titeth").inputs) == {"u_heat": ("*", 1.0), "T_out": ("*", 5.0)}
