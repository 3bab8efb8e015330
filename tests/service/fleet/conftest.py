"""Members choose the log of their process; afterwards the tests have their own again."""

import pytest


@pytest.fixture(autouse=True)
def own_log(restored: None) -> None:
    """The log as it was."""
