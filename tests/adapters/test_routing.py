import pytest

from adapters.reading import Batch, Reading
from adapters.routing import Delivery, Router


def test_each_zone_gets_its_own_readings_in_order_and_the_clock():
    router = Router("bms", ["a/T_i", "b/T_i", "a/T_out", "c/T_i"])
    assert router.zones == ("a", "b", "c")
    first, second, third = Reading("a/T_i", 1.0, 20.0), Reading("b/T_i", 1.0, 21.0), Reading("a/T_out", 1.0, 5.0)
    assert router.split(Batch([first, second, third], 2.0)) == [
        Delivery("a", "bms", [first, third], 2.0),
        Delivery("b", "bms", [second], 2.0),
        Delivery("c", "bms", [], 2.0),
    ]


def test_the_only_zone_gets_all():
    batch = Batch([Reading("a/T_i", 1.0, 20.0)], 2.0)
    assert Router("bms", ["a/T_i"]).split(batch) == [Delivery("a", "bms", batch.readings, 2.0)]
    assert Router("unused", []).split(Batch([], 2.0)) == []


def test_a_channel_that_was_not_announced_is_an_error():
    with pytest.raises(KeyError):
        Router("bms", ["a/T_i", "b/T_i"]).split(Batch([Reading("b/T_x", 1.0, 20.0)], 2.0))
