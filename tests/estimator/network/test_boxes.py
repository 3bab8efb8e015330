"""Boxes from the floor area."""

import math

import pytest

from estimator.errors import NetworkError
from estimator.network.boxes import PER_AREA, WIDEST, boxed
from estimator.network.presets import PRESETS, SOLAR_APERTURE, network

GENERIC = [name for name in PRESETS if name != "building-67"]

BUILDINGS = {
    "a room of 20 m2": {"C_i": 6e5, "C_e": 2e6, "C_h": 3e3, "g_ie": 90.0, "g_e_out": 12.0, "g_i_out": 8.0, "A_w": 0.5},
    "a passive house of 150 m2": {"C_i": 1e7, "C_e": 4e7, "g_ie": 900.0, "g_e_out": 25.0, "g_i_out": 20.0, "A_w": 7.0},
    "an old house of 180 m2": {"C_i": 8e6, "C_e": 7e7, "C_h": 4e5, "g_ie": 1500.0, "g_e_out": 400.0, "g_i_out": 120.0},
    "a hall of 2,000 m2": {
        "C_i": 6e7,
        "C_e": 1.5e9,
        "C_h": 2e7,
        "g_ie": 2e4,
        "g_e_out": 8e3,
        "g_ih": 2e4,
        "A_w": 400.0,
    },
}


@pytest.mark.parametrize("building", BUILDINGS)
def test_the_widest_box_holds_rooms_dwellings_and_halls(building):
    net = boxed(network("titethria").with_solar("T_i", SOLAR_APERTURE)).validate()
    for name, value in BUILDINGS[building].items():
        parameter = net.parameter(name)
        assert parameter.lower < value < parameter.upper, name


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
