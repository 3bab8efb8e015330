"""The state of a fleet for people and for scripts."""

import asyncio
import json
from collections.abc import Mapping
from typing import NamedTuple

from service.errors import ServiceError
from service.fleet import peers
from service.fleet.messages import Beat
from service.fleet.peers import ANSWER_SECONDS, Peer

_TOLD = ("node", "pid", "boot", "plan", "zones")
"""What JSON has of a sign of life by the same name."""


class FleetStatus(NamedTuple):
    version: int
    nodes: Mapping[str, str]
    members: Mapping[str, Beat | None]
    """Every member that there should be, and its sign of life; None where it does not answer."""

    @property
    def moving(self) -> int:
        """Zones that wait until another shard lets go of them."""
        return sum(beat.waiting for beat in self.members.values() if beat is not None)


async def show_status(site: str, as_json: bool, every: float | None) -> None:
    """Print the state of a running fleet, once or every so many s, until interrupted. Raises ServiceError where there
    is none the one time."""
    while True:
        status = await _asked(site)
        if status is not None:
            print(json.dumps(in_json(status)) if as_json else in_lines(status), flush=True)
        elif every is None:
            raise ServiceError(
                f"there is no fleet of the site '{site}' on this cluster; start it with `thermogate fleet run`"
            )
        if every is None:
            return
        await asyncio.sleep(every)


async def _asked(site: str) -> FleetStatus | None:
    """The state of the fleet; None where no plan is kept."""

    async def hear(name: str) -> Beat | None:
        try:
            beat: Beat = await Peer(site, name).ask("beat", 0, timeout=ANSWER_SECONDS)
        except ServiceError:
            return None
        return beat if beat.node in nodes else None

    plan = await asyncio.to_thread(peers.remembered, site)
    if plan is None:
        return None
    nodes = await asyncio.to_thread(peers.nodes)
    names = peers.wanted(plan, nodes)
    beats = await asyncio.gather(*map(hear, names))
    return FleetStatus(plan.version, nodes, dict(zip(names, beats, strict=True)))


def in_json(status: FleetStatus) -> dict[str, object]:
    members = []
    for name, beat in status.members.items():
        told = {key: beat and getattr(beat, key) for key in _TOLD}
        more = {"ready": bool(beat and beat.ready), "url": (beat and beat.url) or None}
        members.append({"name": name} | told | more | {"problems": list(beat.problems) if beat else []})
    nodes = [{"id": node, "address": address} for node, address in status.nodes.items()]
    return {"plan": status.version, "moving_zones": status.moving, "nodes": nodes, "members": members}


def in_lines(status: FleetStatus) -> str:
    moving = f", {status.moving} zones are moving" if status.moving else ""
    lines = [f"plan {status.version}, {len(status.nodes)} machines{moving}"]
    for name, beat in status.members.items():
        if beat is None:
            lines.append(f"{name:<18} does not answer")
            continue
        state, what = "ready" if beat.ready else "starting", beat.url or f"{beat.zones} zones"
        lines.append(
            f"{name:<18} {state:<9} {status.nodes[beat.node]:<16} pid {beat.pid:<8} plan {beat.plan:<4} {what}"
        )
        lines += [f"  {problem}" for problem in beat.problems]
    return "\n".join(lines)
