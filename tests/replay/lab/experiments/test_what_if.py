"""What a day takes and another plan saves, in a building of EnergyPlus, in short."""

import numpy as np
from support.energyplus import needs_energyplus

from replay.lab.experiments.relays import RelayRun
from replay.lab.experiments.what_if import ASKED, TRUE, _figures, days_twice


@needs_energyplus
def test_a_room_is_told_what_a_day_takes_and_lives_it_both_ways():
    found = days_twice(RelayRun("timber", "ekf", 1, 6))
    assert len(found["took"]) == 3
    assert (found["before"][1:] == found["took"][:-1]).all(), "the day that was set back is not lived on"
    # 2 K less save heat on every day; of a house this light about a tenth for each kelvin.
    assert (found["differed"] < 0.0).all()
    assert (-found["differed"] < 0.5 * found["took"]).all()
    for told in (found["demand"], found["difference"]):
        assert (np.diff(told, axis=1) > 0.0).all()
    assert (found["difference"][:, 1] < 0.0).all()
    figures = _figures(found)
    assert figures[ASKED] == 3.0
    assert figures[TRUE] == -found["differed"].mean()
