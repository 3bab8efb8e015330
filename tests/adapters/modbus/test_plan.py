from adapters.modbus.plan import Limits, Point, halves, plan, spanning


def holding(address, size=1, unit=1):
    return Point(unit, "holding", address, size)


def spans(requests):
    return [(request.unit, request.table, request.address, request.size) for request in requests]


def test_neighbours_are_read_together_and_small_gaps_with_them():
    points = [holding(10, 2), holding(0, 2), holding(2), holding(40)]
    assert spans(plan(points, Limits(gap=7))) == [(1, "holding", 0, 12), (1, "holding", 40, 1)]
    assert spans(plan(points, Limits(gap=6))) == [(1, "holding", 0, 3), (1, "holding", 10, 2), (1, "holding", 40, 1)]


def test_no_request_is_longer_than_the_device_allows():
    points = [holding(2 * k, 2) for k in range(200)]
    assert [request.size for request in plan(points, Limits())] == [124, 124, 124, 28]
    assert [request.size for request in plan(points[:4], Limits(registers=5))] == [4, 4]


def test_units_and_tables_are_never_mixed():
    points = [holding(0), holding(1, unit=2), Point(1, "input", 1, 1), Point(1, "coil", 2, 1)]
    assert len(plan(points, Limits(gap=100))) == 4


def test_one_request_each_where_batches_are_off():
    assert len(plan([holding(k) for k in range(5)], Limits(batch=False))) == 5


def test_bits_count_for_a_sixteenth_of_a_register():
    points = [Point(1, "coil", 30 * k, 1) for k in range(3)]
    assert spans(plan(points, Limits(gap=2))) == [(1, "coil", 0, 61)]
    assert spans(plan(points, Limits(gap=2, registers=2))) == [(1, "coil", 0, 31), (1, "coil", 60, 1)]


def test_channels_on_the_same_registers_share_them():
    assert spans(plan([holding(3, 2), holding(3, 2), holding(4)], Limits())) == [(1, "holding", 3, 2)]


def test_halves_leave_out_what_lies_between():
    first, second = halves(spanning([holding(0), holding(1), holding(8), holding(9, 2)]))
    assert spans([first, second]) == [(1, "holding", 0, 2), (1, "holding", 8, 3)]
