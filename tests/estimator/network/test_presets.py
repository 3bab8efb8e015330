"""The networks that come with Thermogate are the paper's."""

import numpy as np
import pytest

from estimator.errors import NetworkError
from estimator.network.assembly import assemble, theta_vector
from estimator.network.discretise import heat_loss, time_constants
from estimator.network.presets import PRESETS, network

STATES = {"m1": 2, "m2": 3, "m3": 3, "m4": 4, "m5": 4, "m6": 4, "m7": 5, "m8": 5}


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_is_valid_and_its_nominal_values_lie_in_their_boxes(name):
    preset = network(name)
    assert preset.name == name
    assert preset.description
    for parameter in preset.parameters:
        assert parameter.nominal is not None
        assert parameter.lower <= parameter.nominal <= parameter.upper, parameter
    constants = time_constants(assemble(preset, theta_vector(preset)))
    assert (constants > 0).all()
    assert (np.diff(constants) > 0).all()


def test_building_67_has_the_published_time_constants_and_heat_loss():
    building = network("building-67")
    assert building.nodes == ("T_i", "T_m", "T_e", "T_h", "T_s")
    assert len(building.free) == 10
    matrices = assemble(building, theta_vector(building))
    hours = time_constants(matrices)[0] / 3600
    np.testing.assert_allclose(hours, [0.0263, 0.2366, 0.5668, 2.6696, 198.6], rtol=2e-3)
    np.testing.assert_allclose(heat_loss(matrices, 0), 130.77, rtol=1e-4)


def test_the_ecolar_zone_is_6r4c_with_ten_parameters_and_its_published_heat_loss():
    zone = network("ecolar-6r4c")
    assert (len(zone.nodes), len(zone.conductances), len(zone.free)) == (4, 6, 10)
    # 60 W/K to the outside and 45 W/K to the adjacent room.
    np.testing.assert_allclose(heat_loss(assemble(zone, theta_vector(zone)), 0), 105.0, rtol=5e-3)


@pytest.mark.parametrize("name", STATES)
def test_candidates_have_the_states_of_table_2(name):
    candidate = network(name)
    assert len(candidate.nodes) == STATES[name]
    assert candidate.inputs == ("T_out", "T_adj", "u_heat")
    assert ("g_air_out" in [edge.name for edge in candidate.conductances]) == (name not in ("m6", "m8"))


def test_m4_is_the_ecolar_zone():
    assert network("m4").parameters == network("ecolar-6r4c").parameters


def test_an_unknown_name_lists_the_right_ones():
    with pytest.raises(NetworkError, match="unknown network 'm9'; the presets are building-67, ecolar-6r4c, m1"):
        network("m9")
