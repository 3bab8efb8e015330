"""The loads that `make load-modbus`, `load-bacnet` and `load-mqtt` measure for minutes, in small: nothing is lost."""

from __future__ import annotations

from typing import Any

import pytest
from integration.loads import PROGRAMS

SMALL: dict[str, dict[str, Any]] = {
    "modbus": {"devices": 5, "registers": 100, "poll": 0.5},
    "bacnet": {"devices": 4, "objects": 50, "poll": 0.5},
    "mqtt": {"topics": 50, "rate": 10.0},
}


@pytest.mark.parametrize("kind", SMALL)
def test_every_poll_and_every_message_brings_its_readings(kind: str) -> None:
    if kind == "bacnet":
        pytest.importorskip("bacpypes3", reason="bacpypes3 is not installed")
    load = PROGRAMS[kind][0](seconds=2.0, **SMALL[kind])
    assert load.readings == load.expected > 0
    if kind == "mqtt":
        assert (load.asked, load.missed) == (50 * 20, 0)
