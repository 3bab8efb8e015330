"""A fleet on two machines of a Ray cluster: served from both, and the same whatever happens to one of them."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from support.campus import POSTED, rooms, write_recording, write_site
from support.fleet import Cluster, Fleet, Machine, get, post_lines, until
from support.harness import Daemon
from support.postgres import Server

from service.web.keys import create_key

pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

ROOMS = rooms(6)
ROWS = 500
PACE = 2400.0
LEASE = 2.0
LEARNED = ("history?limit=20000", "forecast?horizon=3h", "parameters")


class Site:
    """The fleet and its surroundings, for all tests of this file, which come one after the other."""

    def __init__(self, cluster: Cluster, fleet: Fleet, config: Path, key: str) -> None:
        self.cluster, self.fleet, self.config, self.key = cluster, fleet, config, key

    def url(self) -> str:
        """A gateway that answers."""
        return until(lambda: next((url for url in self.fleet.urls() if get(f"{url}/healthz")[0]), ""), "a gateway")

    def get(self, path: str, url: str | None = None) -> tuple[int, Any]:
        return get(f"{url or self.url()}{path}", self.key)

    def zones(self, url: str | None = None) -> dict[str, dict[str, Any]]:
        """What a gateway lists; nothing where it does not answer."""
        status, body = self.get("/zones", url)
        return {zone["id"]: zone for zone in body["zones"]} if status == 200 else {}

    def samples(self) -> dict[str, int]:
        """Samples of every room that its shard tells of."""
        return {name: zone["samples"] for name, zone in self.zones().items() if name in ROOMS}

    def goes_on(self, since: dict[str, int]) -> bool:
        """Whether every room has samples that it did not have before, or has come to the end of its recording."""
        now = self.zones()
        return all(
            name in now and (now[name]["samples"] > since[name] or "come to an end" in now[name]["reason"])
            for name in ROOMS
        )

    def shards(self) -> dict[str, dict[str, Any]]:
        return {shard["name"]: shard for shard in self.fleet.members("shard-")}

    def machine_of(self, pid: int) -> Machine:
        for machine in (self.cluster.head, *self.cluster.others):
            if pid in machine.pids():
                return machine
        raise AssertionError(f"process {pid} is on no machine")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory, postgres_server: Server) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("campus")
    write_recording(folder / "recording.csv", len(ROOMS), ROWS)
    database = f"postgresql://postgres@/postgres?host={postgres_server.folder}"
    config = write_site(
        folder, database, site=f"campus-{os.getpid()}", count=len(ROOMS), shards=2, pace=PACE, lease=LEASE, cpus=1.0
    )
    key = create_key(folder / "state" / "keys.json", "tester", "admin")
    with Cluster() as cluster:
        cluster.add()
        with Fleet(config, cluster.address, folder / "fleet.log") as fleet:
            yield Site(cluster, fleet, config, key)


def test_every_room_is_served_on_every_machine(site: Site) -> None:
    urls = until(lambda: found if len(found := site.fleet.urls()) == 2 else [], "two gateways")
    until(lambda: len(site.shards()) == 2, "two shards")
    assert {shard["node"] for shard in site.shards().values()} == {
        gateway["node"] for gateway in site.fleet.members("gateway-")
    }, "each machine has a shard"
    for url in urls:
        until(lambda url=url: all(site.zones(url)[room]["samples"] > 3 for room in ROOMS), "samples of every room")
        assert set(site.zones(url)) == {*ROOMS, POSTED}
        for room in ROOMS:
            status, forecast = site.get(f"/zones/{room}/forecast?horizon=1h", url)
            assert status == 200, forecast
            assert forecast["zone"] == room
    assert get(f"{urls[0]}/zones")[0] == 401, "keys hold as on one machine"


def test_what_was_accepted_of_a_post_survives_its_shard(site: Site) -> None:
    when = time.time()
    lines = f"{POSTED} T_i=21.5,T_out=4.25,u_heat=900 {when * 1e9:.0f}\n"
    status, taken = post_lines(f"{site.url()}/readings", lines, site.key)
    assert (status, taken["accepted"]) == (200, 3), taken
    before = site.shards()
    owners = [shard for shard in before.values() if POSTED in _zones_of(site, shard["name"])]
    assert len(owners) == 1
    os.kill(owners[0]["pid"], signal.SIGKILL)
    name, boot = owners[0]["name"], owners[0]["boot"]
    until(lambda: site.shards().get(name, {}).get("boot", boot) != boot, "a new process of the shard")

    def repeated() -> bool:
        status, taken = post_lines(f"{site.url()}/readings", lines, site.key)
        assert status in (200, 503), taken
        return status == 200 and (taken["accepted"], taken["repeated"]) == (0, 3)

    until(repeated, "the readings to be known")


def _zones_of(site: Site, shard: str) -> list[str]:
    from service.config.load import load
    from service.fleet.plan import Plan, shard_names

    config = load(site.config)
    owner = Plan(1, config, shard_names(2)).owners()
    return [zone for zone, name in owner.items() if name == shard]


def test_the_rooms_of_a_machine_that_is_lost_go_on_elsewhere(site: Site) -> None:
    since = site.samples()
    lost = site.cluster.others[0]
    gone = [shard for shard in site.shards().values() if site.machine_of(shard["pid"]) is lost]
    assert gone, "the test wants a machine with a shard"
    site.cluster.kill(lost)
    before = {shard["boot"] for shard in gone}
    until(lambda: len(now := _boots(site)) == 2 and before.isdisjoint(now.values()), "new processes of the shards")
    until(lambda: site.goes_on(since), "new samples of every room")


def test_zones_move_to_another_number_of_shards_under_load(site: Site) -> None:
    site.cluster.add()
    # The machine that is added takes its part.
    until(lambda: len(site.fleet.members("gateway-")) == 2, "the machine that was added")
    done = site.fleet.ask("rebalance", "--shards", "3")
    assert done.returncode == 0, done.stderr
    assert "3 shards" in done.stdout

    def settled() -> bool:
        shards = site.shards().values()
        return len(shards) == 3 and sum(shard["zones"] for shard in shards) == len(ROOMS) + 1

    until(settled, "three shards with all zones")
    since = site.samples()
    until(lambda: site.goes_on(since), "new samples of every room")


def test_a_frozen_machine_that_wakes_up_changes_nothing(site: Site) -> None:
    frozen = site.cluster.others[0]
    on_it = {shard["name"] for shard in site.shards().values() if site.machine_of(shard["pid"]) is frozen}
    since = site.samples()
    old = {boot for name, boot in _boots(site).items() if name in on_it}
    frozen.freeze()
    until(lambda: len(site.fleet.status()["nodes"]) == 1, "the machine to be given up")
    until(lambda: len(now := _boots(site)) == 3 and old.isdisjoint(now.values()), "the shards on other machines")
    until(lambda: site.goes_on(since), "new samples of every room")
    before = _boots(site)
    frozen.thaw()
    # Its members find out that they are others' now, and end.
    workers = [pid for pid in frozen.frozen if _is_member(pid)]
    until(lambda: not any(_is_member(pid) for pid in workers), "the members of the frozen machine to end")
    now = _boots(site)
    assert {name: now[name] for name in on_it} == {name: before[name] for name in on_it}


def _boots(site: Site) -> dict[str, str]:
    return {name: shard["boot"] for name, shard in site.shards().items()}


def _is_member(pid: int) -> bool:
    with suppress(OSError):
        return b"ray::Member" in Path(f"/proc/{pid}/cmdline").read_bytes()
    return False


def test_at_the_end_everything_is_as_on_one_machine_that_was_never_disturbed(site: Site, tmp_path: Path) -> None:
    def ended() -> bool:
        zones = site.zones()
        return bool(zones) and all("come to an end" in zones[room]["reason"] for room in ROOMS)

    # The rest in a hurry: the configuration is read again.
    text = site.config.read_text(encoding="utf-8")
    site.config.write_text(text.replace(f"pace = {PACE}", 'pace = "max"'), encoding="utf-8")
    site.fleet.process.send_signal(signal.SIGHUP)
    until(ended, "the end of the recording")
    settings = {"site.state_dir": str(tmp_path / "alone")}
    with Daemon(site.config, tmp_path / "daemon.log", settings) as daemon:
        daemon.wait(lambda zones: all("come to an end" in zones[room]["reason"] for room in ROOMS))
        for room in ROOMS:
            for path in LEARNED:
                status, alone = daemon.get(f"/zones/{room}/{path}")
                assert status == 200, alone
                found = site.get(f"/zones/{room}/{path}")
                assert found == (200, alone), f"{room}: {path}"
            assert len(alone) > 0


def test_it_stops_in_order(site: Site) -> None:
    assert site.fleet.terminate() == 0, site.fleet.log()
    assert "stopped" in site.fleet.log()
    assert "Traceback" not in site.fleet.log()
