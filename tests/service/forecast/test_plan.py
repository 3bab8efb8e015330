"""The grammar of plans."""

import numpy as np
import pytest
from support.tables import tabled

from estimator.network.presets import network
from service.errors import PlanError
from service.forecast.plan import Grid, Plan, Stepped, Timed, check, column

GRID = Grid(start=1000.0, period=100.0, steps=6)


def planned(told):
    """The values of a plan as a table of cases writes them."""
    if isinstance(told, dict):
        ((kind, (when, values)),) = told.items()
        return Stepped(when, np.array(values)) if kind == "stepped" else Timed(np.array(when), np.array(values))
    return np.array(told) if isinstance(told, list) else told


@tabled
def test_a_plan_has_a_value_for_every_period(values, expected):
    np.testing.assert_array_equal(column(planned(values), GRID), expected)


@tabled
def test_values_that_cannot_be_planned_are_one_sentence(values, sentence):
    with pytest.raises(PlanError) as raised:
        check(planned(values), "u_heat", network("titeth"), {"u_heat": (0.0, 2000.0)}, GRID)
    assert str(raised.value).startswith(sentence)


def test_what_is_planned_for_a_zone_goes_before_what_is_planned_for_all():
    plan = Plan(inputs={"*": {"u_heat": 1.0, "T_out": 5.0, "I_sol": 0.0}, "own": {"u_heat": 2.0}})
    assert plan.of("own", network("titeth").inputs) == {"u_heat": ("own", 2.0), "T_out": ("*", 5.0)}
    assert plan.of("other", network("titeth").inputs) == {"u_heat": ("*", 1.0), "T_out": ("*", 5.0)}
