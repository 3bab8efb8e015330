"""What the routes have behind them, and how a route takes the site and the zone that it is about."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Annotated, NamedTuple

from fastapi import Depends, Request

from adapters.http.posted import Posted
from service.publish.events import Streams
from service.records.receipt import Receipt
from service.records.view import ZoneView
from service.web.access import Asking, find_zone
from service.web.limits import Limiter

Problems = Callable[[], list[str]]
"""What in the daemon does not answer, one sentence each."""

Reload = Callable[[], Awaitable[str]]
"""Reads the configuration again and says what was done; raises ReloadRefused."""

Take = Callable[[Sequence[Posted], str | None], Awaitable[Receipt]]
"""Takes what was posted, for all zones or one; what is accepted is durable on return. Raises ServiceError."""


class Backend(NamedTuple):
    """What the routes have behind them beside the zones."""

    version: str = "unknown"
    time_zone: str | None = None
    """Of the site (IANA), for the page and for times of day."""
    problems: Problems = list
    reload: Reload | None = None
    take: Take | None = None
    streams: Streams | None = None
    """Where the zones announce what happens; without it a stream tells what there is and no more."""


class Site(NamedTuple):
    """The site that an application serves."""

    id: str
    zones: Mapping[str, ZoneView]
    """By id, in the order to list them; whichever there are when a request comes."""
    limiter: Limiter
    streams: Streams
    backend: Backend


async def site_of(request: Request) -> Site:
    """Dependency: the site that is asked about."""
    return request.app.state.site


Here = Annotated[Site, Depends(site_of)]


async def zone_of(zone: str, site: Here, caller: Asking) -> ZoneView:
    """Dependency: the zone that the path names; RequestRefused if there is none that the caller sees."""
    return find_zone(site.zones, zone, caller)


Asked = Annotated[ZoneView, Depends(zone_of)]
