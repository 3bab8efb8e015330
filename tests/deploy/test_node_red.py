"""The example for Node-RED, run by a real Node-RED between a real broker and the daemon's own HTTP server."""

import asyncio
import json
import os
import shutil
import sys
from pathlib import Path

import pytest
from prometheus_client import CollectorRegistry
from support.broker import Party, broker
from support.fake_zones import running
from support.harness import EXAMPLES
from support.processes import Program
from support.served import config, serving
from support.waiting import until

from adapters.reading import Quality
from service.publish.mqtt import MqttConfig, Publisher
from service.publish.payloads import AheadPayload, NextHeatingPayload
from service.publish.sinks import Announcement, Reports
from service.web.app import create_app

NODE_RED = Path(os.environ.get("THERMOGATE_NODE_RED", Path(sys.prefix) / "node-red"))
SETTINGS = """module.exports = {
    flowFile: "flows.json", httpAdminRoot: false, httpNodeRoot: false,
    telemetry: { enabled: false, updateNotification: false }, externalModules: { autoInstall: false },
};
"""


def node_red(folder: Path, flow: str) -> Program:
    """Node-RED with a `flow`, and neither editor nor port."""
    program = NODE_RED / "node_modules" / "node-red" / "red.js"
    if shutil.which("node") is None or not program.exists():
        pytest.skip("Node-RED is not installed here (make .venv/node-red)")
    (folder / "flows.json").write_text(flow, encoding="utf-8")
    (folder / "settings.js").write_text(SETTINGS, encoding="utf-8")
    command = ["node", program, "--userDir", folder, "--settings", folder / "settings.js"]
    return Program(command, folder / "log", cwd=folder)


async def test_it_tells_the_house_when_to_heat_and_how_warm_it_will_be(tmp_path: Path) -> None:
    zone = running("room1")
    update = zone.updates[-1]
    start, forecast = update.time + 3600.0, update.forecast
    heating = NextHeatingPayload(21.0, start + 7200.0, 0.9, start, 0.95)
    times = (update.time, forecast.issue_time, forecast.valid_time)
    reports = Reports(ahead=AheadPayload(*times, 1800.0, 0.95, Quality.GOOD, (), (), heating))
    announcement = Announcement("htwg", "room1", zone.now()._replace(update=update), reports=reports)
    app = create_app("htwg", {"room1": zone}, CollectorRegistry())
    async with serving(app, config()) as server:
        with broker(tmp_path) as mosquitto, Party(mosquitto.port, "house/#") as house:
            flow = (EXAMPLES / "node-red.json").read_text(encoding="utf-8")
            for written, used in (('"1883"', f'"{mosquitto.port}"'), ("http://127.0.0.1:8080", server.url)):
                assert flow.count(written) == 1
                flow = flow.replace(written, used)
            publisher = Publisher(MqttConfig(host="127.0.0.1", port=mosquitto.port, client_id="daemon"), "htwg").open()
            publisher.add("room1")
            publisher.publish(announcement)
            with node_red(tmp_path, flow) as node:

                def told() -> bool:
                    assert node.process.poll() is None, node.log()
                    return house.newest().keys() >= {"house/room1/heating-start", "house/room1/in-6h"}

                await until(told)
            await asyncio.to_thread(publisher.close)
    published = json.loads(announcement.payload("ahead"))
    assert house.newest()["house/room1/heating-start"].decode() == published["heating"]["start"]
    later = json.loads(house.newest()["house/room1/in-6h"])
    assert later.keys() == {"valid_time", "mean", "sd", "quality"}
    assert 0 < later["mean"] < 40
