"""CSV files as the tests look at them."""

import csv
from pathlib import Path


def rows_of(path: Path) -> list[dict[str, str]]:
    """The rows of the table at `path`, by column."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
