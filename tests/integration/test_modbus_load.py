"""The load that `make load-modbus` measures for ten minutes, in small: no poll is missed, no reading lost."""

from integration.modbus_load import measure


def test_a_few_devices_are_polled_without_a_miss():
    load = measure(devices=5, registers=100, seconds=4.0, poll=1.0)
    assert load.readings == load.polls * 100
    assert load.polls >= 5 * 4
    assert load.missed == 0, load.lines()
