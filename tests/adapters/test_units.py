import pytest
from support.tables import tabled

from adapters.units import Affine, conversion


@tabled
def test_values_convert(value, from_unit, to_unit, expected):
    scale, offset = conversion(from_unit, to_unit)
    assert value * scale + offset == pytest.approx(expected, rel=1e-9)


def test_energy_becomes_power_times_seconds_and_percent_only_with_a_nominal_power():
    joules = {"Wh": 3600.0, "kWh": 3.6e6, "MJ": 1e6, "GJ": 1e9, "J": 1.0}
    assert {unit: conversion(unit, "W") for unit in joules} == {unit: Affine(one, 0.0) for unit, one in joules.items()}
    assert conversion("%", "W", 2000.0) == Affine(20.0, 0.0)
