"""Preheating in a building of EnergyPlus, in short."""

import numpy as np
from support.energyplus import needs_energyplus

from replay.lab.experiments.preheat import EARLY, IN_TIME, MORNINGS, _figures, mornings
from replay.lab.experiments.relays import RelayRun


@needs_energyplus
def test_a_room_is_asked_every_night_and_lives_with_the_answer():
    found = mornings(RelayRun("timber", "ekf", 1, 6))
    assert len(found["told"]) == 3
    # A light house under a relay is warm within half an hour, so that every start is in time.
    assert found["warm"].all()
    assert found["lately"].all()
    assert (found["promised"] > 0.5).all()
    assert np.isfinite(found["early"]).all()
    figures = _figures(found)
    assert figures[MORNINGS] == 3.0
    assert figures[IN_TIME] == 1.0
    assert 0.0 <= figures[EARLY] <= 360.0
