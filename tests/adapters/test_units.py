import pytest

from adapters.units import Affine, conversion


@pytest.mark.parametrize(
    ("value", "from_unit", "to_unit", "expected"),
    [
        (293.15, "K", "degC", 20.0),
        (20.0, "degC", "K", 293.15),
        (68.0, "degF", "degC", 20.0),
        (20.0, "degC", "degF", 68.0),
        (0.0, "degF", "K", 255.3722222),
        (1.5, "kW", "W", 1500.0),
        (0.002, "MW", "kW", 2.0),
        (3412.141633, "BTU/h", "W", 1000.0),
        (0.4, "kW/m2", "W/m2", 400.0),
        (35.0, "%", "1", 0.35),
    ],
)
def test_values_convert(value, from_unit, to_unit, expected):
    scale, offset = conversion(from_unit, to_unit)
    assert value * scale + offset == pytest.approx(expected, rel=1e-9)


def test_energy_becomes_power_times_seconds_and_percent_only_with_a_nominal_power():
    joules = {"Wh": 3600.0, "kWh": 3.6e6, "MJ": 1e6, "GJ": 1e9, "J": 1.0}
    assert {unit: conversion(unit, "W") for unit in joules} == {unit: Affine(one, 0.0) for unit, one in joules.items()}
    assert conversion("%", "W", 2000.0) == Affine(20.0, 0.0)
