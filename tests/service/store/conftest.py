"""Every store there is: tests that take it are run over each."""

from pathlib import Path

import pytest
from support.kept import InDatabase, InFolder, Kept


@pytest.fixture(params=["sqlite", "postgres"])
def kept(request: pytest.FixtureRequest, tmp_path: Path) -> Kept:
    """Where a store keeps what it has."""
    return InFolder(tmp_path) if request.param == "sqlite" else InDatabase(request.getfixturevalue("shards"))
