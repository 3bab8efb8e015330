"""The fault menu: what is asked for, and the sentences for what the plant cannot have."""

import pytest
from support.bms_plant import Clock, simulation, started
from support.tables import tabled

from replay.bms.faults import FaultError, parse_spec
from replay.bms.simulation import Simulation


def test_a_fault_as_it_is_written_on_the_command_line() -> None:
    spec = parse_spec("drift:room1/T_air, value=-0.5, after=10min, for=1h")
    assert (spec.kind, spec.device, spec.channel) == ("drift", "room1", "T_air")
    assert (spec.value, spec.after, spec.duration) == (-0.5, 600, 3600)
    bare = parse_spec("clock-jump")
    assert (bare.device, bare.channel, bare.value, bare.after, bare.duration) == (None, None, None, 0, None)
    assert parse_spec("slow,for=30").duration == 30


@tabled
def test_what_the_plant_cannot_have_is_refused(text: str, gist: str) -> None:
    plant = simulation(Clock())
    with pytest.raises(FaultError) as mistake:
        plant.faults.add(parse_spec(text))
    assert gist in str(mistake.value)
    assert plant.faults.listed() == []


def told(plant: Simulation, place: str) -> float:
    """The value of a sensor, such as "room1/T_air"."""
    name, _, channel = place.partition("/")
    (device,) = (one for one in plant.plant if one.name == name)
    (found,) = (one for one in device.channels if one.name == channel)
    return plant.value(device, found)


def test_a_value_leaps_for_a_tenth_of_every_minute() -> None:
    clock = Clock()
    plant, begun = simulation(clock), clock.now
    true = told(plant, "room1/T_air")
    plant.faults.add(parse_spec("spikes:room1/T_air,value=-5"))
    leaps = []
    for second in range(120):
        clock.now = begun + second
        leaps.append(told(plant, "room1/T_air") - true)
    assert leaps == pytest.approx(2 * [*6 * [-5.0], *54 * [0.0]])


def test_a_late_value_is_the_one_of_before() -> None:
    clock, plant = started()
    plant.faults.add(parse_spec("late:room2/T_air,value=30"))
    true, shown = [], []
    for _ in range(90):
        plant.catch_up()
        true.append(plant.world.now.air[1] + plant.world.now.noise[1])
        shown.append(told(plant, "room2/T_air"))
        clock.now += 1.0
    assert len(set(true)) > 80
    assert shown == [*30 * [true[0]], *true[:60]]
    ((_, kept),) = plant.faults._kept.items()
    assert len(kept) <= 31, "older values than will be shown are not kept"


def test_thermometers_change_places() -> None:
    plant = simulation(Clock())
    places = ("room1/T_air", "room2/T_air", "weather/T_out", "weather/T_out_F")
    before = [told(plant, place) for place in places]
    fault = plant.faults.add(parse_spec("swapped-sensors:room2"))
    room1, room2, outdoor, fahrenheit = (told(plant, place) for place in places)
    assert room1 == before[0]
    assert room2 == pytest.approx(before[2], abs=0.5), "but for the noise of another sensor"
    assert outdoor == pytest.approx(before[1], abs=0.5)
    assert fahrenheit == pytest.approx(outdoor * 1.8 + 32)
    assert abs(room2 - outdoor) > 5.0
    plant.faults.remove(fault.id)
    assert [told(plant, place) for place in places] == before


def test_faults_that_have_ended_are_forgotten_also_where_nobody_lists_them() -> None:
    clock, plant = started()
    device = plant.plant[1]
    for _ in range(100):
        plant.faults.add(parse_spec("freeze:room1,for=1s"))
        plant.value(device, device.channels[0])
        clock.now += 2.0
    assert len(plant.faults._faults) == len(plant.faults._kept) == 1
