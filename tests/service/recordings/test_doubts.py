"""What looks wrong with telemetry before anything is learned from it."""

import numpy as np
import pytest
from support.harness import EXAMPLES
from support.tables import tabled

from estimator.heat.sun import Location
from service.config.load import load
from service.config.site import Whereabouts
from service.recordings.doubts import doubts
from service.recordings.samples import Recorded
from service.records.sample import Sample

ZONE = load(EXAMPLES / "generic-csv.toml").zones[0]
HOURS = np.arange(24.0 * 14)
DAY = 2.0 * np.pi * HOURS / 24.0
ROOM = 20.5 + 0.5 * np.sin(DAY)
OUTDOORS = 4.0 + 5.0 * np.sin(DAY)
HEATING = 1500.0 * (np.sin(DAY) < 0.0)


def recorded(zone, times, values, refused=None):
    outputs = len(zone.network.measured)
    samples = [Sample(int(time), row[:outputs], row[outputs:], (), ()) for time, row in zip(times, values, strict=True)]
    return Recorded(samples, refused or {}, values.size)


def told(room=ROOM, outdoors=OUTDOORS, heating=HEATING, hours=HOURS):
    assert ZONE.network.channels == ("T_i", "T_out", "u_heat")
    return doubts(ZONE, recorded(ZONE, 3600.0 * hours, np.stack([room, outdoors, heating], axis=1)))


def test_ordinary_telemetry_is_not_doubted():
    assert told() == []
    assert told(room=24.0 + 2.0 * np.sin(DAY), outdoors=22.0 + 6.0 * np.sin(DAY)) == []
    assert told(room=np.where(HOURS % 3 == 0, ROOM, np.nan)) == []


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"room": 32.0 + 1.8 * ROOM}, 'T_i is 68.9 degC in the middle, usual are 5 to 40; write unit = "degF"'),
        ({"outdoors": OUTDOORS + 273.15}, 'write unit = "K" if it is in K'),
        ({"heating": HEATING / 1000.0}, 'u_heat is 1.5 W at most; write unit = "kW"'),
        ({"heating": HEATING * 1000.0}, "u_heat is 758929 W on average, more than 10000 is unusual; look at its unit"),
        ({"heating": 0.0 * HEATING}, "u_heat is 0 W all the time"),
        ({"room": OUTDOORS + 10.0, "outdoors": ROOM}, "T_i varies by 3.5 K and T_out by 0.4 K; are the two swapped?"),
        ({"outdoors": 0.0 * OUTDOORS + 7.0}, "T_out is 7 degC all the time; is its sensor connected?"),
    ],
)
def test_a_mistake_is_named_with_its_remedy(changes, sentence):
    (found,) = told(**changes)
    assert sentence in found


def test_readings_only_on_change_are_told_with_what_holds_them():
    outdoors = np.where(HOURS % 3 == 0, OUTDOORS, np.nan)
    room = np.where(HOURS % 24 < 4, ROOM, np.nan)
    assert told(outdoors=outdoors) == [
        "66% of its intervals are not used, for T_out has had no reading for more than 15min; write "
        'hold_inputs = "1d" if it is recorded only when it changes'
    ]
    (sentence,) = told(room=room)
    assert "T_i has had no reading for more than 3h; write max_gap = 96 if" in sentence


def test_a_set_point_in_another_unit_is_named():
    zone = ZONE.model_copy(update={"setpoint": ZONE.channels["T_i"]})
    found = recorded(zone, 3600.0 * HOURS, np.stack([ROOM, OUTDOORS, HEATING], axis=1))

    def told_of(setpoint):
        return doubts(zone, found._replace(samples=[one._replace(setpoint=setpoint) for one in found.samples]))

    assert told_of(21.0) == []
    (sentence,) = told_of(69.8)
    assert sentence.startswith('setpoint is 69.8 degC in the middle, usual are 5 to 40; write unit = "degF"')


def test_swapped_days_and_months_are_named():
    # The first days of January to April, as 01.02. to 04.02. and so on would be read.
    days = [np.datetime64(f"2025-{month:02}-01", "D") + np.arange(4) for month in (1, 2, 3, 4)]
    hours = (np.concatenate(days).astype(np.int64)[:14, None] * 24.0 + np.arange(24.0)).ravel()
    (found,) = told(hours=hours)
    assert "as if day and month were swapped; write how times are to be read" in found
    assert told(hours=hours[-1] - HOURS[::-1]) == []


def test_the_sun_tells_that_the_time_zone_is_missing():
    zone = load(EXAMPLES / "flexhouse.toml").zones[0]
    zone = zone.model_copy(update={"whereabouts": Whereabouts(Location(48.0, 15.0))})
    network = zone.network
    values = np.full((len(HOURS), len(network.channels)), np.nan)

    def found(ahead):
        """At 15 degrees east the sun is highest at 11 h UTC."""
        sun = 600.0 * np.maximum(np.cos(DAY - 2.0 * np.pi * (11.0 + ahead) / 24.0), 0.0)
        values[:, network.channels.index("I_sol")] = sun
        return doubts(zone, recorded(zone, 3600.0 * HOURS, values))

    assert found(0.0) == []
    (sentence,) = found(2.0)
    assert sentence.startswith("I_sol is highest 2.0 h after noon at longitude 15; write the time zone")


def test_a_short_history_is_named():
    (found,) = told(*(column[:10] for column in (ROOM, OUTDOORS, HEATING, HOURS)))
    assert found.startswith("it covers 0.4 days")


@tabled
def test_many_refused_readings_are_told_with_what_to_look_at(fault, remedy):
    values = np.stack([ROOM, OUTDOORS, HEATING], axis=1)
    few = {"duplicated": 3}
    assert doubts(ZONE, recorded(ZONE, 3600.0 * HOURS, values, few)) == []
    (found,) = doubts(ZONE, recorded(ZONE, 3600.0 * HOURS, values, few | {fault: 501}))
    assert found == f"50 % of it is refused, most as {fault}; look at {remedy}"
    assert doubts(ZONE, Recorded([], {fault: 9}, 9)) == [f"100 % of it is refused, most as {fault}; look at {remedy}"]
