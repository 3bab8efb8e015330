"""Zenoh sessions on this machine, for those who watch a daemon."""

from __future__ import annotations

import json
from typing import Literal

import zenoh


def loopback_session(mode: Literal["peer", "client"], port: int) -> zenoh.Session:
    """A peer that listens on `port`, or a client that connects to it; zenoh.ZError where that is impossible."""
    endpoints = "listen/endpoints" if mode == "peer" else "connect/endpoints"
    config = zenoh.Config()
    for key, value in {
        "mode": mode,
        endpoints: [f"tcp/127.0.0.1:{port}"],
        "scouting/multicast/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)
