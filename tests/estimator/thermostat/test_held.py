"""Rooms that their thermostat holds."""

import numpy as np

from estimator.thermostat.held import FORCED, HELD, IDLE, states
from estimator.thermostat.law import no_laws

RELAY = no_laws()._replace(side=np.ones(1), switching=np.ones(1), numbers=np.array([[2000.0, 0.0, 0.6]]))


def test_a_relay_that_switches_holds_its_room_however_far_it_swings():
    temperatures, on = np.array([[23.0, 23.0, 19.0, 19.0]]), np.array([[[0.1], [0.0], [0.9], [1.0]]])
    assert states(temperatures, RELAY, np.array([21.0]), on).tolist() == [[HELD, IDLE, HELD, FORCED]]
    assert states(temperatures, RELAY, np.array([np.nan]), on).tolist() == [[IDLE] * 4]
