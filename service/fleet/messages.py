"""What the members of a fleet tell each other."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from service.publish.sinks import Announcement


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


class News(NamedTuple):
    """What is new in a shard since `version` of before, or all there is for a gateway that knows another `boot`."""

    boot: str
    version: int
    zones: Sequence[Announcement]
    """The newest of each."""
    refused: Mapping[str, str]
    """Zones that the shard cannot run, and why."""
