"""The state of a fleet for people and for scripts."""

from __future__ import annotations

from typing import Any

from service.fleet.steward import FleetStatus


def as_json(status: FleetStatus) -> dict[str, Any]:
    """Every figure of `status`; times in s."""
    return {
        "plan": status.version,
        "moving_zones": status.moving,
        "quarantined_zones": list(status.quarantined),
        "nodes": [{"id": node, "address": address} for node, address in status.nodes.items()],
        "members": [
            {
                "name": name,
                "node": None if beat is None else beat.node,
                "pid": None if beat is None else beat.pid,
                "boot": None if beat is None else beat.boot,
                "plan": None if beat is None else beat.version,
                "ready": beat is not None and beat.ready,
                "zones": None if beat is None else beat.zones,
                "url": None if beat is None else beat.url or None,
                "heard_s": None if beat is None else round(ago, 3),
                "problems": [] if beat is None else list(beat.problems),
            }
            for name, beat, ago in status.members
        ],
    }


def as_table(status: FleetStatus) -> str:
    """A line for every member."""
    lines = [
        f"plan {status.version}, {len(status.nodes)} machines"
        + (f", {status.moving} zones are moving" if status.moving else "")
        + (f", quarantined: {', '.join(status.quarantined)}" if status.quarantined else "")
    ]
    for name, beat, ago in status.members:
        if beat is None:
            lines.append(f"{name:<18} starting")
            continue
        where = status.nodes.get(beat.node, "a lost machine")
        state = "ready" if beat.ready else "starting"
        what = beat.url or f"{beat.zones} zones"
        lines.append(
            f"{name:<18} {state:<9} {where:<16} pid {beat.pid:<8} plan {beat.version:<4} {what}, {ago:.1f} s ago"
        )
        lines += [f"  {problem}" for problem in beat.problems]
    return "\n".join(lines)
