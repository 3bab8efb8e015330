"""What the members of a fleet tell each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from service.publish.sinks import NO_REPORTS, Occasion, Reports
from service.records.status import ZoneStatus
from service.records.trust import Trust
from service.records.update import Update


class Beat(NamedTuple):
    """A sign of life. `boot` names the process: a member that was started anew has another one."""

    name: str
    boot: str
    node: str
    pid: int
    plan: int
    """The version of the plan that it goes by; 0 before the first."""
    zones: int = 0
    waiting: int = 0
    """Zones of its own that another shard still has."""
    ready: bool = False
    problems: Sequence[str] = ()
    url: str = ""
    """Where a gateway serves."""
    reload_wanted: bool = False
    """Whether a client of a gateway has asked for a reload."""


class ZoneNews(NamedTuple):
    """The newest that a zone has announced, and how it is doing."""

    zone: str
    status: ZoneStatus
    trust: Trust
    update: Update | None
    occasion: Occasion
    reports: Reports = NO_REPORTS


class News(NamedTuple):
    """What is new in a shard since `version` of before, or all there is for a gateway that knows another `boot`."""

    boot: str
    version: int
    zones: Sequence[ZoneNews]
    refused: Mapping[str, str]
    """Zones that the shard cannot run, and why."""
