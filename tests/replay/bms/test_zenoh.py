"""What the BMS puts on Zenoh, received by a session of its own."""

import json
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import zenoh
import zenoh.ext
from support.bms_plant import Clock, simulation
from support.processes import free_port

from replay.bms.faults import parse_spec
from replay.bms.simulation import Simulation
from replay.bms.zenoh_publisher import ZenohPublisher, opened
from replay.errors import ReplayError

NOW = 1_750_000_000.0


@contextmanager
def published(plant: Simulation) -> Iterator[tuple[ZenohPublisher, str]]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    publisher = ZenohPublisher.open(endpoint, plant)
    try:
        yield publisher, endpoint
    finally:
        publisher.close()


def received(plant: Simulation, *wanted: str) -> dict[str, zenoh.Sample]:
    """What is published once, from the cache, which answers the one who comes too late; until all of `wanted` came."""
    with (
        published(plant) as (publisher, endpoint),
        opened({"connect/endpoints": [endpoint], "listen/endpoints": []}) as session,
    ):
        publisher.publish(NOW)
        with zenoh.ext.declare_advanced_subscriber(
            session, "bms/**", history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
        ) as subscriber:
            samples: dict[str, zenoh.Sample] = {}
            deadline = time.monotonic() + 180
            while not set(wanted) <= set(samples):
                assert time.monotonic() < deadline, sorted(samples)
                sample = subscriber.try_recv()
                if sample is None:
                    time.sleep(0.01)
                else:
                    samples[str(sample.key_expr)] = sample
            return samples


def document(sample: zenoh.Sample) -> dict:
    return json.loads(sample.payload.to_string())


def test_every_format_carries_the_same_value_and_its_time() -> None:
    plant = simulation(Clock())
    keys = [f"bms/senml/{device.name}" for device in plant.plant]
    keys += [
        f"bms/{form}/{device.name}/{channel.name}"
        for form in ("plain", "json")
        for device in plant.plant
        for channel in device.channels
    ]
    samples = received(plant, *keys)
    assert set(samples) == set(keys)
    plain = samples["bms/plain/room2/T_air"]
    assert plain.encoding == zenoh.Encoding.TEXT_PLAIN
    value = float(plain.payload.to_string())
    assert value == pytest.approx(plant.world.now.air[1], abs=0.2)
    assert plain.timestamp.get_time().timestamp() == pytest.approx(time.time(), abs=60)
    read = document(samples["bms/json/room2/T_air"])
    exact = read["present"]["value"]
    assert exact == pytest.approx(value, abs=1e-4)
    assert read == {"present": {"value": exact, "unit": "degC"}, "time": "2025-06-15T15:06:40.000Z", "quality": "good"}
    records = document(samples["bms/senml/room2"])
    assert [record["n"] for record in records] == ["T_air", "heat_power", "energy", "valve", "set_point"]
    assert records[0] == {"bn": "room2/", "n": "T_air", "u": "Cel", "v": exact, "t": NOW}
    assert {record["t"] for record in records} == {NOW}


def test_faults_of_values_and_clocks_show_here_too() -> None:
    plant = simulation(Clock())
    for text in ("nan:room1", "clock-jump:room2,value=-7200", "silent:room3"):
        plant.faults.add(parse_spec(text))
    samples = received(plant, "bms/senml/room2", "bms/json/room1/T_air", "bms/plain/room1/T_air")
    missing = document(samples["bms/json/room1/T_air"])
    assert (missing["present"]["value"], missing["quality"]) == (None, "bad")
    assert math.isnan(float(samples["bms/plain/room1/T_air"].payload.to_string()))
    assert {record["t"] for record in document(samples["bms/senml/room2"])} == {NOW - 7200}
    assert not any("room3" in key for key in samples)


def test_a_taken_endpoint_is_said_in_one_sentence() -> None:
    plant = simulation(Clock())
    with published(plant) as (_, endpoint), pytest.raises(ReplayError, match=f"--zenoh {endpoint}: .* cannot be used"):
        ZenohPublisher.open(endpoint, plant)
