"""The running record: daily sums that stay bounded."""

import numpy as np

from estimator.diagnosis.record import DAYS, no_record, recorded_days, with_sample

DAY, PERIOD = 86400, 3600.0


def filled(days, output=20.0, inputs=(5.0, 1000.0), first=0):
    record = no_record(len(inputs))
    for hour in range(24 * days):
        record = with_sample(record, first + hour * 3600, PERIOD, output, np.array(inputs))
    return record


def test_sums_are_integrals_over_the_day():
    record = filled(2, first=3 * DAY)
    assert record.days[3] == 3
    assert record.seconds[3] == DAY
    assert record.output[3] == 20.0 * DAY
    assert record.inputs[3].tolist() == [5.0 * DAY, 1000.0 * DAY]
    assert recorded_days(record) == 2.0
    assert record.largest.tolist() == [5.0, 1000.0]


def test_old_days_give_way_and_the_size_stays():
    record = filled(DAYS + 3)
    assert recorded_days(record) == DAYS
    assert sorted(record.days) == list(range(3, DAYS + 3))
    assert [values.shape for values in record] == [values.shape for values in no_record(2)]


def test_a_missing_output_counts_for_nothing_but_the_largest_input():
    record = with_sample(no_record(2), 0, PERIOD, np.nan, np.array([-5.0, 800.0]))
    assert recorded_days(record) == 0.0
    assert record.largest.tolist() == [0.0, 800.0]


def test_a_record_is_never_changed():
    before = filled(1)
    copies = [values.copy() for values in before]
    with_sample(before, 5 * DAY, PERIOD, 21.0, np.array([1.0, 2.0]))
    assert all((values == copy).all() for values, copy in zip(before, copies, strict=True))
