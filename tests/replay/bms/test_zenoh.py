"""What the BMS puts on Zenoh, received by a session of its own."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import zenoh
import zenoh.ext
from support.bms_plant import Clock, simulation
from support.harness import free_port

from replay.bms.faults import parse_spec
from replay.bms.simulation import Simulation
from replay.bms.zenoh_publisher import ZenohPublisher
from replay.errors import ReplayError

NOW = 1_750_000_000.0


@contextmanager
def subscriber_session(endpoint: str) -> Iterator[zenoh.Session]:
    config = zenoh.Config()
    for key, value in {
        "connect/endpoints": [endpoint],
        "listen/endpoints": [],
        "scouting/multicast/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    try:
        yield session
    finally:
        session.close()


@contextmanager
def published(plant: Simulation) -> Iterator[tuple[ZenohPublisher, str]]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    publisher = ZenohPublisher.open(endpoint, plant)
    try:
        yield publisher, endpoint
    finally:
        publisher.close()


def received(plant: Simulation, wanted: int) -> dict[str, zenoh.Sample]:
    """Samples of `wanted` keys; rounds are published until they are there, for the first may find no subscriber."""
    with published(plant) as (publisher, endpoint), subscriber_session(endpoint) as session:
        subscriber = session.declare_subscriber("bms/**")
        samples: dict[str, zenoh.Sample] = {}
        deadline = time.monotonic() + 60
        while len(samples) < wanted:
            assert time.monotonic() < deadline, sorted(samples)
            publisher.publish(NOW)
            time.sleep(0.02)
            while (sample := subscriber.try_recv()) is not None:
                samples[str(sample.key_expr)] = sample
        subscriber.undeclare()
        return samples


def test_every_format_carries_the_same_value_and_its_time() -> None:
    plant = simulation(Clock(), meters=2)
    channels = [channel for device in plant.plant if device.published for channel in device.channels]
    samples = received(plant, 2 * len(channels) + 4)
    truth = plant.world.now.air[1]

    plain = samples["bms/plain/room2/T_air"]
    assert plain.encoding == zenoh.Encoding.TEXT_PLAIN
    assert float(plain.payload.to_string()) == pytest.approx(truth, abs=0.2)
    assert plain.timestamp is not None
    assert plain.timestamp.get_time().timestamp() == pytest.approx(time.time(), abs=60)

    document = json.loads(samples["bms/json/room2/T_air"].payload.to_string())
    assert document["present"]["value"] == pytest.approx(float(plain.payload.to_string()), abs=1e-4)
    assert document["present"]["unit"] == "degC"
    assert document["time"] == "2025-06-15T15:06:40.000Z"
    assert document["quality"] == "good"

    records = json.loads(samples["bms/senml/room2"].payload.to_string())
    assert records[0]["bn"] == "room2/"
    assert [record["n"] for record in records] == ["T_air", "heat_power", "energy", "valve", "set_point"]
    assert records[0]["u"] == "Cel"
    assert records[0]["v"] == pytest.approx(document["present"]["value"])
    assert {record["t"] for record in records} == {NOW}

    assert not any("meter" in key for key in samples), "devices for load are on Modbus only"


def test_faults_of_values_and_clocks_show_here_too() -> None:
    plant = simulation(Clock())
    for text in ("nan:room1", "clock-jump:room2,value=-7200", "silent:room3"):
        plant.faults.add(parse_spec(text))
    with published(plant) as (publisher, endpoint), subscriber_session(endpoint) as session:
        publisher.publish(NOW)
        # The cache answers the one who comes too late.
        with zenoh.ext.declare_advanced_subscriber(
            session, "bms/**", history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
        ) as subscriber:
            samples: dict[str, str] = {}
            deadline = time.monotonic() + 60
            while "bms/senml/room2" not in samples or "bms/json/room1/T_air" not in samples:
                assert time.monotonic() < deadline, sorted(samples)
                sample = subscriber.try_recv()
                if sample is not None:
                    samples[str(sample.key_expr)] = sample.payload.to_string()
                else:
                    time.sleep(0.01)
    missing = json.loads(samples["bms/json/room1/T_air"])
    assert (missing["present"]["value"], missing["quality"]) == (None, "bad")
    assert {record["t"] for record in json.loads(samples["bms/senml/room2"])} == {NOW - 7200}
    assert not any("room3" in key for key in samples)


def test_plain_says_nan() -> None:
    plant = simulation(Clock())
    plant.faults.add(parse_spec("nan:room2/T_air"))
    assert math.isnan(float(received(plant, 30)["bms/plain/room2/T_air"].payload.to_string()))


def test_a_taken_endpoint_is_said_in_one_sentence() -> None:
    plant = simulation(Clock())
    with published(plant) as (_, endpoint), pytest.raises(ReplayError, match=f"--zenoh {endpoint}: .* cannot be used"):
        ZenohPublisher.open(endpoint, plant)
