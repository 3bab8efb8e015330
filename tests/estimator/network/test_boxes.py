"""Boxes from the floor area."""

import math

import pytest
from support.tables import tabled

from estimator.errors import NetworkError
from estimator.network.boxes import PER_AREA, WIDEST, boxed
from estimator.network.presets import PRESETS, SOLAR_APERTURE, network

GENERIC = [name for name in PRESETS if name != "building-67"]


@tabled
def test_the_widest_box_holds_rooms_dwellings_and_halls(building, values):
    net = boxed(network("titethria").with_solar("T_i", SOLAR_APERTURE)).validate()
    for name, value in values.items():
        parameter = net.parameter(name)
        assert parameter.lower < value < parameter.upper, (building, name)


@pytest.mark.parametrize("name", GENERIC)
@pytest.mark.parametrize("area", [20.0, 120.0, 2000.0])
def test_a_floor_area_gives_a_box_inside_the_widest(name, area):
    wide, narrow = boxed(network(name)).validate(), boxed(network(name), area, area).validate()
    for outer, inner in zip(wide.parameters, narrow.parameters, strict=True):
        assert outer.lower <= inner.lower < inner.upper <= outer.upper
        if inner.name in PER_AREA:
            assert inner.lower == pytest.approx(PER_AREA[inner.name][0] * area)
            assert math.log10(outer.upper / outer.lower) == pytest.approx(
                math.log10(inner.upper / inner.lower) + math.log10(WIDEST[1] / WIDEST[0])
            )
        if inner.nominal is not None:
            assert inner.lower <= inner.nominal <= inner.upper


def test_fixed_parameters_and_shares_of_heat_stay():
    net = network("m5").with_fixed(["C_h"])
    wide = boxed(net)
    assert wide.parameter("C_h") == net.parameter("C_h")
    assert wide.parameter("f_air") == net.parameter("f_air")


def test_a_network_of_one_building_has_no_box_per_area():
    with pytest.raises(NetworkError, match="C_m"):
        boxed(network("building-67"))
