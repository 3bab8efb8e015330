"""A worker's checkpoint brings it back bit for bit."""

import json
from dataclasses import replace

import pytest
from support.zone_samples import NAN, comparable, sample, worker

from estimator.network.presets import network
from estimator.registry import resolve, structure
from service.store.checkpoint import CheckpointStore
from service.zone import snapshot


def through_disk(zone, folder):
    store = CheckpointStore(folder)
    store.save("z", snapshot.take(zone, "mark", "rbpf"))
    back = worker()
    snapshot.restore(back, store.load("z", "mark"))
    return back


@pytest.mark.parametrize("stop", [1, 2, 17, 32, 36, 37])
def test_what_comes_back_continues_with_the_same_bits(stop, tmp_path):
    """Stopped in the middle of plain running, of a bridged gap, of a stall and of a row of outliers."""
    samples = [sample(k) for k in range(30)]
    samples += [sample(k, y=NAN) for k in range(30, 35)]
    samples += [sample(35), sample(36, y=99.0), sample(37, y=99.0), sample(38, inputs=[NAN, 18.0, 0.0])]
    samples += [sample(k) for k in range(39, 50)]
    zone = worker()
    for item in samples[:stop]:
        zone.step(item)
    back = through_disk(zone, tmp_path)
    assert comparable(back.latest) == comparable(zone.latest)
    assert back.progress == zone.progress
    for item in samples[stop:]:
        assert comparable(back.step(item)) == comparable(zone.step(item))


def test_the_meta_data_are_what_json_gives_back():
    zone = worker()
    for k in range(5):
        zone.step(sample(k, y=NAN if k == 4 else None))
    meta = snapshot.take(zone, "mark", "rbpf").meta
    assert repr(json.loads(json.dumps(meta))) == repr(meta), "lists, numbers and texts, in full"
    assert "nan" in repr(meta)


def test_before_the_first_update_there_is_nothing_to_keep():
    assert snapshot.take(worker(), "mark", "rbpf") is None


def test_the_fingerprint_tells_what_a_state_belongs_to():
    zone = network("ecolar-6r4c")

    def mark(net=zone, period=300.0, **options):
        return snapshot.fingerprint(net, period, "rbpf", structure("rbpf", resolve("rbpf", net, period, options)))

    assert mark() == mark()
    assert mark(measurement_sd=0.2) == mark(), "tuning does not make the state another one"
    same = replace(zone, name="mine", description="reworded", initial={})
    assert mark(net=same) == mark()
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
