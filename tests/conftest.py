"""What all tests share: a database server, and the daemon's choice of a kernel cache, made before Numba is imported."""

from __future__ import annotations

import asyncio
import inspect
import logging
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings
from support import postgres
from support.processes import Program

from service.daemon.process import prepare_process

prepare_process()

# No test depends on how fast the machine is.
settings.register_profile("tests", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("tests")

Program.forks = True

if TYPE_CHECKING:
    from support.shards import Shards

LONG = ("integration/", "browser/", "deploy/", "replay/", "service/store/", "thermogate/", "test_", "estimator/")
"""Where the files are that take long, in the order in which they are begun."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that take long come first: behind the others, all processes but one would wait for the last of them."""
    places = [f"tests/{name}" for name in LONG]
    items.sort(key=lambda item: [not item.nodeid.startswith(place) for place in places])


PATIENCE = 600.0
"""s after which a test that is a coroutine fails."""


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """A test that is a coroutine has an event loop of its own."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    work = pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names})
    asyncio.run(asyncio.wait_for(work, PATIENCE))
    return True


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[postgres.Server]:
    """A PostgreSQL server for tests that leave it as it is; each takes a site of its own. Skips where there is none."""
    with postgres.server() as running:
        yield running


@pytest.fixture
def shards(postgres_server: postgres.Server) -> Iterator[Shards]:
    """The owners of a site of its own in PostgreSQL."""
    from support.shards import Shards

    made = Shards(postgres_server)
    yield made
    made.close()


@pytest.fixture
def restored() -> Iterator[None]:
    """The root logger, and what else logging changes, as they were."""
    root, hook = logging.getLogger(), threading.excepthook
    handlers, level = root.handlers[:], root.level
    yield
    root.handlers, root.level, threading.excepthook = handlers, level, hook
    logging.captureWarnings(False)
