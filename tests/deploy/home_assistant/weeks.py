"""A documented rule over weeks that were recorded: the environment names the rule, the record and where alarms go."""

import csv
import json
import lzma
import os
from collections import defaultdict
from pathlib import Path

from homeassistant.core import Event, HomeAssistant, callback
from homeassistant.setup import async_setup_component


async def test_the_rule_over_the_record(hass: HomeAssistant) -> None:
    """Notes when the rule notifies, room by room, each of which is the living room in its turn."""
    given = json.loads(os.environ["THERMOGATE_RULE"])
    alarms: dict[str, list[int]] = defaultdict(list)
    now: list[tuple[str, int]] = []

    @callback
    def note(event: Event) -> None:
        zone, time = now[-1]
        alarms[zone].append(time)

    hass.bus.async_listen("automation_triggered", note)
    assert await async_setup_component(hass, "persistent_notification", {})
    assert await async_setup_component(hass, "automation", {"automation": [given["rule"]]})
    hass.states.async_set("sensor.thermogate_living_state", "running")
    with lzma.open(given["record"], "rt", encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            now.append((row["zone"], int(row["time"])))
            bounds = {name: int(row[name]) for name in ("lower", "upper")}
            hass.states.async_set("sensor.thermogate_living_unmeasured_heat", row["median"], bounds)
            await hass.async_block_till_done()
    Path(given["alarms"]).write_text(json.dumps(alarms))
