"""The rooms of a module, ROOMS, as they are served."""

from collections.abc import Iterator

import pytest
from fastapi import FastAPI
from support.site_of_rooms import site_of

from service.zone.zone import Zone

Site = tuple[FastAPI, dict[str, Zone]]


@pytest.fixture(scope="module")
def site(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    with site_of(tmp_path_factory.mktemp("site"), request.module.ROOMS) as made:
        yield made


@pytest.fixture
def app(site: Site) -> FastAPI:
    return site[0]
