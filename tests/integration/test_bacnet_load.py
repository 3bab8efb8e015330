"""The load that `make load-bacnet` measures for ten minutes, in small: no reading of a poll is lost."""

import pytest

pytest.importorskip("bacpypes3", reason="bacpypes3 is not installed")

from integration.bacnet_load import measure


def test_of_a_few_devices_every_poll_brings_every_object():
    load = measure(devices=4, objects=50, seconds=2.0, poll=0.5)
    assert load.polls > 0
    assert load.readings == load.polls * 50
