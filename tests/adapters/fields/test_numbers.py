from adapters.fields.numbers import read_number, read_whole


def test_numbers_of_a_command_line():
    assert [read_number(text) for text in ("1e3", " -2 ")] == [1000.0, -2.0]
    assert {read_number(text) for text in ("inf", "nan", "x", "1_0", "\uff11")} == {None}
    assert [read_whole(text) for text in ("12", "-1", "1.0", "²", "\uff11", "9" * 5000)] == [12] + [None] * 5
