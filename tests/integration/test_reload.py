"""A reload of the real daemon: what is the same goes on as if nothing had happened."""

import tomllib
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from support import sites
from support.harness import Daemon, ask, reload
from support.modbus_plant import configuration, plant, running
from support.waiting import wait_until

from service.web.keys import create_key

SPEED = 20_000


def zone(table: dict[str, Any], name: str) -> dict[str, Any]:
    return next(zone for zone in table["zones"] if zone["id"] == name)


class Home:
    """A home of two rooms, its configuration as a table that can be changed, and the file that has it."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        rooms = ["kitchen", "living"]
        log = sites.recording(folder / "recording.csv", rooms, 2 * 288, 300, (61, 3)) | {"pace": SPEED}
        # A source for each zone.
        zones = [sites.recorded(room, room, period="5min", estimator_options={"particles": 300}) for room in rooms]
        self.path = sites.written(folder, dict.fromkeys(rooms, log), zones)
        self.table = tomllib.loads(self.path.read_text())

    def write(self) -> None:
        """Write the configuration, with the sources alone that a zone reads."""
        used = {channel["source"] for zone in self.table["zones"] for channel in zone["channels"].values()}
        sources = {name: source for name, source in self.table["sources"].items() if name in used}
        self.path.write_text(tomli_w.dumps(self.table | {"sources": sources}))

    def reload(self, daemon: Daemon, told: str) -> None:
        """Write the configuration and have it read again."""
        self.write()
        reload(daemon, told)

    def add(self, like: str, name: str, **changes: Any) -> None:
        """A zone that reads what the zone `like` reads."""
        self.table["zones"].append(zone(self.table, like) | {"id": name} | changes)

    def keep(self, *names: str) -> None:
        """Remove every other zone."""
        self.table["zones"] = [zone for zone in self.table["zones"] if zone["id"] in names]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[sites.Table]]:
    """What a replay makes of the home's zones."""
    home = Home(tmp_path_factory.mktemp("undisturbed") / "home")
    return sites.replayed(home.path, home.path.with_name("out"))


def test_zones_that_stay_the_same_do_so_to_the_last_bit(
    tmp_path: Path, undisturbed: dict[str, list[sites.Table]]
) -> None:
    home = Home(tmp_path / "home")
    kept, other = (zone["id"] for zone in home.table["zones"])
    original = dict(zone(home.table, kept))
    # Under load: eight more zones share the source and the threads, and come, change and go.
    for number in range(8):
        home.add(kept, f"extra-{number}")
    home.write()
    with Daemon(home.path, home.path.with_name("log")) as daemon:
        daemon.wait(lambda zones: zones[kept]["samples"] >= 40)
        home.keep(kept, other, *(f"extra-{number}" for number in range(2, 8)))
        zone(home.table, "extra-2")["levels"] = [0.9, 0.5]
        home.add(kept, "late")
        home.reload(daemon, "configuration reloaded: added late; changed extra-2; removed extra-0, extra-1")
        stored = tomllib.loads((home.path.parent / "state" / "configuration.toml").read_text())
        assert [one["id"] for one in stored["zones"]] == [one["id"] for one in home.table["zones"]]
        # The forecast that stands is the old one until the changed zone's next sample.
        samples = daemon.wait(lambda zones: "extra-0" not in zones)["extra-2"]["samples"]
        daemon.wait(lambda zones: zones["late"]["samples"] >= 10 and zones["extra-2"]["samples"] > samples)
        status, body = daemon.get("/zones/extra-2/forecast")
        assert [interval["level"] for interval in body["intervals"]] == [0.9, 0.5], (status, body)
        assert daemon.get("/zones/extra-0")[0] == 404
        home.keep(kept, other, "late")
        home.reload(daemon, "removed extra-2, extra-3, extra-4, extra-5, extra-6, extra-7")
        daemon.wait_until_ended()
        assert zone(home.table, kept) == original
        # The late zone read the recording from its beginning, and learned the same as one that began in time.
        for name, rows in undisturbed.items():
            sites.same_history(daemon, name, rows)
        assert [row["time"] for row in daemon.history("late")] == [row["time"] for row in undisturbed[kept]]
        assert daemon.terminate() == 0
        assert "Traceback" not in daemon.log()


def test_what_changes_or_comes_back_goes_on_and_what_stands_against_it_is_said(
    tmp_path: Path, undisturbed: dict[str, list[sites.Table]]
) -> None:
    home = Home(tmp_path / "home")
    first, second = (zone["id"] for zone in home.table["zones"])
    whole = list(home.table["zones"])
    admin = create_key(home.path.parent / "state" / "keys.json", "boss", "admin")
    with Daemon(home.path, home.path.with_name("log")) as daemon:
        daemon.key = admin

        def asked(secret: str | None = admin) -> tuple[int, dict[str, Any]]:
            return ask(f"{daemon.url()}/admin/reload", b"", secret)

        assert asked(None)[0] == 401
        answer = wait_until(lambda: None if "still starting" in (got := asked())[1].get("detail", "") else got)
        assert answer == (200, {"status": "reloaded", "done": "nothing has changed"})
        daemon.wait(lambda zones: zones[first]["samples"] >= 30)
        # It changes what is published, not what is learned: the state goes on to the last bit.
        zone(home.table, first)["levels"] = [0.95, 0.8]
        home.reload(daemon, f"configuration reloaded: changed {first}")
        assert daemon.log().count(f"zone '{first}' goes on after") == 1
        # A zone that goes and comes back is restored.
        home.keep(first)
        home.write()
        assert asked() == (200, {"status": "reloaded", "done": f"removed {second}"})
        assert f'zone="{second}"' not in daemon.text("/metrics")
        home.table["zones"] = whole
        home.reload(daemon, f"configuration reloaded: added {second}")
        assert f"zone '{second}' goes on after" in daemon.log()
        # What stands against a reload is said, and nothing changes.
        period = zone(home.table, first)["period"]
        zone(home.table, first)["period"] = "20min"
        home.reload(daemon, f"not reloaded: zone '{first}': its network, period, estimator")
        status, document = asked()
        (problem,) = document["errors"]
        assert (status, problem.startswith(f"zone '{first}': its network, period, estimator")) == (409, True)
        home.path.write_text("[site]\nid = 7\n[[zones]]")
        reload(daemon, "not reloaded: site.id")
        assert "not reloaded: sources" in daemon.log()
        home.path.unlink()
        reload(daemon, "cannot be read")
        home.table["site"]["checkpoint_every"], zone(home.table, first)["period"] = "7min", period
        home.reload(daemon, "not reloaded: site.checkpoint_every: this takes effect with the next start only")
        assert set(daemon.wait_until_ended()) == {first, second}
        for name, rows in undisturbed.items():
            sites.same_history(daemon, name, rows)
        assert daemon.terminate() == 0


def test_a_live_source_keeps_its_connection_and_loses_no_sample(tmp_path: Path) -> None:
    with running(plant(holding=[215, 53, 400, 21, 190, 60])) as site:
        path = configuration(tmp_path, {"bms": site.port})
        table = tomllib.loads(path.read_text())
        (kept,) = table["zones"]
        added = kept | {"id": "added", "channels": {name: dict(where) for name, where in kept["channels"].items()}}
        added["channels"]["T_i"]["register"] = 4

        def goes_on() -> None:
            samples = daemon.until("zone-bms", lambda status: status["state"] == "running")["samples"]
            daemon.until("zone-bms", lambda status: status["samples"] >= samples + 3)

        with Daemon(path, tmp_path / "log") as daemon:
            daemon.until("zone-bms", lambda status: status["samples"] >= 3)
            path.write_text(tomli_w.dumps(table | {"zones": [kept, added]}))
            reload(daemon, "configuration reloaded: added added")
            daemon.until("added", lambda status: status["samples"] >= 3)
            path.write_text(tomli_w.dumps(table))
            reload(daemon, "configuration reloaded: removed added")
            goes_on()
            assert site.connections == 1
            rows = daemon.history("zone-bms")
            times = [datetime.fromisoformat(row["time"]).timestamp() for row in rows]
            assert times == [times[0] + step for step in range(len(times))]
            # The very first interval may have begun before its first reading.
            assert all(row["y"] is not None for row in rows[1:])
            # A changed source is opened anew, and its zones go on.
            table["sources"]["bms"]["poll"] = 0.3
            path.write_text(tomli_w.dumps(table))
            reload(daemon, "configuration reloaded: sources changed: bms")
            goes_on()
            assert site.connections == 2
            assert "goes on after" not in daemon.log()
            assert daemon.terminate() == 0
