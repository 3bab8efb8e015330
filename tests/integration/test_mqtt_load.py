"""The load that `make load-mqtt` measures for ten minutes, in small: no message is lost, and none comes twice."""

from integration.mqtt_load import measure


def test_of_many_topics_every_message_becomes_a_reading():
    load = measure(topics=50, rate=10.0, seconds=2.0)
    assert load.sent == 50 * 20
    assert (load.missed, load.doubled) == (0, 0)
