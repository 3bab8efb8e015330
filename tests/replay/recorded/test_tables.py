import gzip
from pathlib import Path

import numpy as np

from replay.recorded.tables import cells, write_table


def test_cells_round_mark_decimals_and_leave_nan_empty() -> None:
    assert cells(np.array([1.25, -0.001, np.nan, 20.0]), 2) == ["1.25", "0.00", "", "20.00"]
    assert cells(np.array([-7.31]), 1, ",") == ["-7,3"]


def test_gzipped_table_depends_on_its_content_alone(tmp_path: Path) -> None:
    columns = [["1", "2"], ["", "4"]]
    one = write_table(tmp_path / "one.csv.gz", ["a", "b"], columns, ";").read_bytes()
    two = write_table(tmp_path / "two.csv.gz", ["a", "b"], columns, ";").read_bytes()
    assert one == two
    assert gzip.decompress(one) == b"a;b\n1;\n2;4\n"
