"""The load that `make load-modbus` measures for ten minutes, in small: no reading of a poll is lost."""

from integration.modbus_load import measure


def test_of_a_few_devices_every_poll_brings_every_register():
    load = measure(devices=5, registers=100, seconds=4.0, poll=1.0)
    assert load.polls > 0
    assert load.readings == load.polls * 100
