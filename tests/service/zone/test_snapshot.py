"""A worker's checkpoint brings it back bit for bit."""

from dataclasses import replace

import pytest
from support.thermostat_house import samples as house
from support.zone_samples import NAN, comparable, fed, sample, worker

from estimator.network.presets import network
from estimator.registry import resolve, structure
from service.store.checkpoint import CheckpointStore
from service.zone import snapshot


def through_disk(zone, back, folder):
    """What `zone` knows in a worker as `back`, by way of a checkpoint's file."""
    store = CheckpointStore(folder)
    store.save("z", snapshot.take(zone, "mark", "rbpf"))
    snapshot.restore(back, store.load("z", "mark"))
    return back


@pytest.mark.parametrize("stop", [1, 2, 17, 32, 36, 37])
def test_what_comes_back_continues_with_the_same_bits(stop, tmp_path):
    """Stopped in the middle of plain running, of a bridged gap, of a stall and of a row of outliers."""
    samples = [sample(k) for k in range(30)]
    samples += [sample(k, y=NAN) for k in range(30, 35)]
    samples += [sample(35), sample(36, y=99.0), sample(37, y=99.0), sample(38, inputs=[NAN, 18.0, 0.0])]
    samples += [sample(k) for k in range(39, 50)]
    zone = fed(worker(), samples[:stop])
    back = through_disk(zone, worker(), tmp_path)
    assert comparable(back.latest) == comparable(zone.latest)
    assert back.progress == zone.progress
    for item in samples[stop:]:
        assert comparable(back.step(item)) == comparable(zone.step(item))


KINDS = {
    "rbpf": {"particles": 50},
    "ekf": {},
    "bank": {"members": {"steady": {"estimator": "ekf"}, "arx": {"estimator": "arx"}}},
}


@pytest.mark.parametrize("name", KINDS)
def test_all_that_a_zone_has_learned_in_days_goes_on_with_the_same_bits(name, tmp_path):
    """Its thermostat, the day before, what was verified, the balance and findings of its diagnosis, its trust."""
    period, stop = 1800, 3 * 48
    samples = list(house(4, period))
    zone, fresh = (worker(name, "tite", period, **KINDS[name]) for _ in range(2))
    back = through_disk(fed(zone, samples[:stop]), fresh, tmp_path)
    assert repr((back.skill(), back.trust, back.diagnosis())) == repr((zone.skill(), zone.trust, zone.diagnosis()))
    for item in samples[stop:]:
        assert comparable(back.step(item)) == comparable(zone.step(item))
    kept, whole = snapshot.take(back, "mark", name), snapshot.take(zone, "mark", name)
    assert {part: array.tobytes() for part, array in kept.arrays.items()} == {
        part: array.tobytes() for part, array in whole.arrays.items()
    }


def test_before_the_first_update_there_is_nothing_to_keep():
    assert snapshot.take(worker(), "mark", "rbpf") is None


def test_the_fingerprint_tells_what_a_state_belongs_to():
    zone = network("ecolar-6r4c")

    def mark(net=zone, period=300.0, **options):
        return snapshot.fingerprint(net, period, "rbpf", structure("rbpf", resolve("rbpf", net, period, options)))

    assert mark() == mark()
    assert mark(measurement_sd=0.2) == mark(), "tuning does not make the state another one"
    assert mark(net=replace(zone, name="mine", description="reworded", initial={})) == mark()
    fixed = zone.with_fixed(["C_h"])
    assert mark(net=fixed) == mark(net=fixed.with_parameter("C_h", upper=2e5)), "a fixed parameter needs no bounds"
    others = [
        mark(particles=100),
        mark(coordinates="log"),
        mark(period=600.0),
        mark(net=zone.with_fixed(["C_h"])),
        mark(net=zone.with_parameter("C_h", upper=2e5)),
        mark(volatility_blocks={"a": ["T_air"], "b": ["T_wo", "T_wi", "T_h"]}),
    ]
    assert len({mark(), *others}) == len(others) + 1
