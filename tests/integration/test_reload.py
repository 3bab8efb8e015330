"""A reload of the real daemon: what is the same goes on as if nothing had happened."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from support.harness import Daemon, ask, reload
from support.waiting import wait_until

from replay.lab.measuring.scenario import Scenario, write
from service.web.keys import create_key

SPEED = 20_000


def zone(table: dict[str, Any], name: str) -> dict[str, Any]:
    return next(zone for zone in table["zones"] if zone["id"] == name)


class Home:
    """A simulated home, its configuration as a table that can be changed, and the file that has it."""

    def __init__(self, folder: Path) -> None:
        self.path = write(Scenario(2, 300, "titeth", 600.0 / SPEED, 2 * 288), folder)
        self.table = tomllib.loads(self.path.read_text())
        (source,) = self.table["sources"].values()
        # A source for each zone.
        self.table["sources"] = {zone["id"]: source for zone in self.table["zones"]}
        for zone in self.table["zones"]:
            for channel in zone["channels"].values():
                channel["source"] = zone["id"]
        self.write()

    def write(self) -> None:
        """Write the configuration, with the sources alone that a zone reads."""
        used = {channel["source"] for zone in self.table["zones"] for channel in zone["channels"].values()}
        sources = {name: source for name, source in self.table["sources"].items() if name in used}
        self.path.write_text(tomli_w.dumps(self.table | {"sources": sources}))

    def add(self, like: str, name: str, **changes: Any) -> None:
        """A zone that reads what the zone `like` reads."""
        self.table["zones"].append(zone(self.table, like) | {"id": name} | changes)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[dict[str, Any]]]:
    """The history of the home's zones where nobody reloads anything."""
    home = Home(tmp_path_factory.mktemp("undisturbed") / "home")
    names = [zone["id"] for zone in home.table["zones"]]
    with Daemon(home.path, home.path.with_name("log")) as daemon:
        daemon.wait_until_ended()
        return {name: daemon.history(name) for name in names}


def test_zones_that_stay_the_same_do_so_to_the_last_bit(
    tmp_path: Path, undisturbed: dict[str, list[dict[str, Any]]]
) -> None:
    home = Home(tmp_path / "home")
    kept, *others = undisturbed
    original = dict(zone(home.table, kept))
    # Under load: eight more zones share the source and the threads, and come, change and go.
    for number in range(8):
        home.add(kept, f"extra-{number}")
    home.write()
    with Daemon(home.path, home.path.with_name("log")) as daemon:
        daemon.wait(lambda zones: zones[kept]["samples"] >= 40)
        home.table["zones"] = [zone for zone in home.table["zones"] if zone["id"] not in ("extra-0", "extra-1")]
        zone(home.table, "extra-2")["levels"] = [0.9, 0.5]
        home.add(kept, "late")
        home.write()
        reload(daemon, "configuration reloaded: added late; changed extra-2; removed extra-0, extra-1")
        stored = tomllib.loads((home.path.parent / "state" / "configuration.toml").read_text())
        assert [one["id"] for one in stored["zones"]] == [one["id"] for one in home.table["zones"]]
        # The forecast that stands is the old one until the changed zone's next sample.
        samples = daemon.wait(lambda zones: "extra-0" not in zones)["extra-2"]["samples"]
        daemon.wait(lambda zones: zones["late"]["samples"] >= 10 and zones["extra-2"]["samples"] > samples)
        status, body = daemon.get("/zones/extra-2/forecast")
        assert [interval["level"] for interval in body["intervals"]] == [0.9, 0.5], (status, body)
        assert daemon.get("/zones/extra-0")[0] == 404
        home.table["zones"] = [zone for zone in home.table["zones"] if zone["id"] in (kept, *others, "late")]
        home.write()
        reload(daemon, "removed extra-2, extra-3, extra-4, extra-5, extra-6, extra-7")
        daemon.wait_until_ended()
        assert zone(home.table, kept) == original
        # The late zone read the recording from its beginning, and learned the same as one that began in time.
        for name in undisturbed:
            assert daemon.history(name) == undisturbed[name], name
        assert [row["time"] for row in daemon.history("late")] == [row["time"] for row in undisturbed[kept]]
        assert daemon.terminate() == 0
        assert "Traceback" not in daemon.log()


def test_a_changed_zone_goes_on_from_its_checkpoint(
    tmp_path: Path, undisturbed: dict[str, list[dict[str, Any]]]
) -> None:
    home = Home(tmp_path / "home")
    name, *_ = undisturbed
    with Daemon(home.path, home.path.with_name("log")) as daemon:
        daemon.wait(lambda zones: zones[name]["samples"] >= 60)
        # It changes what is published, not what is learned: the state goes on to the last bit.
        zone(home.table, name)["levels"] = [0.95, 0.8]
        home.write()
        reload(daemon, f"configuration reloaded: changed {name}")
        assert daemon.log().count(f"zone '{name}' goes on after") == 1
        daemon.wait_until_ended()
        assert daemon.history(name) == undisturbed[name]


def test_what_stands_against_a_reload_is_said_and_nothing_changes(tmp_path: Path) -> None:
    home = Home(tmp_path / "home")
    first, second = (zone["id"] for zone in home.table["zones"])
    with Daemon(home.path, home.path.with_name("log")) as daemon:
        daemon.wait(lambda zones: zones[first]["samples"] >= 5)
        home.table["zones"].pop()
        zone(home.table, first)["period"] = "20min"
        home.write()
        reload(daemon, f"not reloaded: zone '{first}': its network, period, estimator")
        home.path.write_text("[site]\nid = 7\n[[zones]]")
        reload(daemon, "not reloaded: site.id")
        assert "not reloaded: sources" in daemon.log()
        home.path.unlink()
        reload(daemon, "cannot be read")
        assert set(daemon.wait(lambda zones: True)) == {first, second}
        home.table["site"]["checkpoint_every"] = "7min"
        zone(home.table, first)["period"] = "10min"
        home.write()
        reload(daemon, "not reloaded: site.checkpoint_every: this takes effect with the next start only")
        assert daemon.terminate() == 0


def test_a_zone_that_comes_back_is_restored(tmp_path: Path, undisturbed: dict[str, list[dict[str, Any]]]) -> None:
    home = Home(tmp_path / "home")
    first, second = (zone["id"] for zone in home.table["zones"])
    whole = list(home.table["zones"])
    with Daemon(home.path, home.path.with_name("log")) as daemon:
        daemon.wait(lambda zones: zones[second]["samples"] >= 30)
        home.table["zones"] = [zone for zone in whole if zone["id"] == first]
        home.write()
        reload(daemon, f"configuration reloaded: removed {second}")
        assert f'zone="{second}"' not in daemon.text("/metrics")
        home.table["zones"] = whole
        home.write()
        reload(daemon, f"configuration reloaded: added {second}")
        assert f"zone '{second}' goes on after" in daemon.log()
        daemon.wait_until_ended()
        for name in (first, second):
            assert daemon.history(name) == undisturbed[name]


def test_a_reload_over_rest_takes_an_administrator(tmp_path: Path) -> None:
    home = Home(tmp_path / "home")
    first, second = (zone["id"] for zone in home.table["zones"])

    admin = create_key(home.path.parent / "state" / "keys.json", "boss", "admin")
    with Daemon(home.path, home.path.with_name("log")) as daemon:

        def asked(secret: str | None) -> tuple[int, dict[str, Any]]:
            return ask(f"{daemon.url()}/admin/reload", b"", secret)

        assert asked(None)[0] == 401
        answer = wait_until(lambda: None if "still starting" in (got := asked(admin))[1].get("detail", "") else got)
        assert answer == (200, {"status": "reloaded", "done": "nothing has changed"})
        home.table["zones"] = [zone for zone in home.table["zones"] if zone["id"] == first]
        home.write()
        assert asked(admin) == (200, {"status": "reloaded", "done": f"removed {second}"})
        zone(home.table, first)["period"] = "1h"
        home.write()
        status, document = asked(admin)
        assert status == 409
        (problem,) = document["errors"]
        assert problem.startswith(f"zone '{first}': its network, period, estimator")
