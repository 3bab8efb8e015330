import numpy as np

from replay.recorded.tables import cells, write_table


def test_a_table_rounds_and_leaves_nan_empty(tmp_path):
    columns = {"a": cells(np.array([1.25, -0.001, np.nan]), 2), "b": ["x", "y", "z"]}
    assert write_table(tmp_path / "one.csv", columns).read_bytes() == b"a,b\n1.25,x\n0.00,y\n,z\n"
