"""Tables as the tests read them: CSV files, and cases beside a test."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import pytest

Test = TypeVar("Test", bound=Callable[..., Any])


def rows_of(path: Path) -> list[dict[str, str]]:
    """The rows of the table at `path`, by column."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def tabled(test: Test) -> Test:
    """Parametrises `test` by its table in `cases.json` beside it: first the columns, then a case in each row.

    A text in place of a row is a remark on the next one.
    """
    tables = json.loads(Path(test.__code__.co_filename).with_name("cases.json").read_text(encoding="utf-8"))
    columns, *rows = tables[test.__name__.removeprefix("test_")]
    return pytest.mark.parametrize(columns, [row for row in rows if isinstance(row, list)])(test)
