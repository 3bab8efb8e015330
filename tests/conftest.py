"""What all tests share: a database server, and the daemon's choice of a kernel cache, made before Numba is imported."""

from collections.abc import Iterator

import pytest
from support import postgres

from service.daemon.process import prepare_process

prepare_process()


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[postgres.Server]:
    """A PostgreSQL server for tests that leave it as it is; each takes a site of its own. Skips where there is none."""
    with postgres.server() as running:
        yield running
