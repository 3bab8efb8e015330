"""The loads that `make load-modbus`, `load-bacnet` and `load-mqtt` measure for minutes, in small: nothing is lost."""

from __future__ import annotations

import pytest


def test_of_a_few_modbus_devices_every_poll_brings_every_register() -> None:
    from integration.modbus_load import measure

    load = measure(devices=5, registers=100, seconds=2.0, poll=0.5)
    assert load.polls > 0
    assert load.readings == load.polls * 100


def test_of_a_few_bacnet_devices_every_poll_brings_every_object() -> None:
    pytest.importorskip("bacpypes3", reason="bacpypes3 is not installed")
    from integration.bacnet_load import measure

    load = measure(devices=4, objects=50, seconds=2.0, poll=0.5)
    assert load.polls > 0
    assert load.readings == load.polls * 50


def test_of_many_topics_every_message_becomes_a_reading() -> None:
    from integration.mqtt_load import measure

    load = measure(topics=50, rate=10.0, seconds=2.0)
    assert load.sent == 50 * 20
    assert (load.missed, load.doubled) == (0, 0)
