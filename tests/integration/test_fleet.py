"""A fleet on two machines of a Ray cluster: served from both, and the same whatever happens to one of them."""

import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import zenoh
from support import sites
from support.campus import POSTED, posted, rooms, write_site
from support.fleet import Cluster, Fleet, Machine, get, post, post_lines, until
from support.harness import Daemon, thermogate
from support.poison.sitecustomize import POISON
from support.postgres import Server, server
from support.zenoh_plant import endpoint
from support.zenoh_plant import session as zenoh_session

pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

from service.web.keys import create_key

SITE = f"campus-{os.getpid()}"
ROOMS = rooms(6)
ROWS = 450
PACE = 1200.0
LEASE = 2.0
POISONED, LIVE = "poisoned", "live"
MEASURED = {"T_i": 21.5, "T_out": 4.25, "u_heat": 900.0}
LEARNED = ("history?limit=20000", "forecast?horizon=3h", "parameters")


class Site(NamedTuple):
    """The fleet and its surroundings, for all tests of this file, which come one after the other."""

    cluster: Cluster
    fleet: Fleet
    database: Server
    session: zenoh.Session
    config: Path
    key: str

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
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("campus")
    place = endpoint()
    live = sites.zone(LIVE, "bms", {name: {"key": f"plant/{name}"} for name in MEASURED}, period=2, estimator="ekf")
    with server() as database, Cluster() as cluster, zenoh_session(listen=place) as session:
        config = write_site(
            folder,
            f"postgresql://postgres@/postgres?host={database.folder}",
            site=SITE,
            count=len(ROOMS),
            shards=2,
            pace=PACE,
            lease=LEASE,
            rows=ROWS,
            zenoh={"listen": [], "connect": [place]},
            sources={"bms": {"kind": "zenoh", "connect": [place]}},
            zones=[posted(POISONED, 4), live],
        )
        key = create_key(folder / "state" / "keys.json", "tester", "admin")
        cluster.add()
        with Fleet(config, cluster.address, folder / "fleet.log") as fleet:
            yield Site(cluster, fleet, database, session, config, key)


def test_every_room_is_served_on_every_machine(site: Site) -> None:
    urls = until(lambda: found if len(found := site.fleet.urls()) == 2 else [], "two gateways")
    until(lambda: len(site.shards()) == 2, "two shards")
    assert {shard["node"] for shard in site.shards().values()} == {
        gateway["node"] for gateway in site.fleet.members("gateway-")
    }, "each machine has a shard"
    for url in urls:
        until(lambda url=url: all(site.zones(url)[room]["samples"] > 3 for room in ROOMS), "samples of every room")
        assert set(site.zones(url)) == {*ROOMS, POSTED, POISONED, LIVE}
        for room in ROOMS:
            status, forecast = site.get(f"/zones/{room}/forecast?horizon=1h", url)
            assert status == 200, forecast
            assert forecast["zone"] == room
    assert get(f"{urls[0]}/zones")[0] == 401, "keys hold as on one machine"


def test_questions_on_zenoh_are_answered_for_a_zone_and_for_the_site(site: Site) -> None:
    def asked(selector: str, body: object = None) -> list[dict[str, Any]]:
        payload = None if body is None else json.dumps(body).encode()
        replies = site.session.get(f"thermogate/{SITE}/{selector}", payload=payload, timeout=60)
        return [json.loads(reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]

    for room in ROOMS:
        (fan,) = until(lambda room=room: asked(f"{room}/fan?horizon=1h"), f"a fan of {room}")
        assert (fan["zone"], bool(fan["fan"])) == (room, True)
    # No shard knows all rooms.
    body = {"horizon": "1h", "zones": ROOMS, "plans": [{"inputs": {"*": {"u_heat": 0.0}}}]}
    (forecasts, *others) = until(lambda: asked("forecasts", body), "forecasts of every room")
    assert {zone["zone"] for zone in forecasts["plans"][0]["zones"]} == set(ROOMS)
    assert others == [], "one gateway answers for all"


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
    from service.fleet.plan import Plan

    return [zone for zone, name in Plan(1, load(site.config)).owners().items() if name == shard]


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
    text = site.config.read_text(encoding="utf-8")
    site.config.write_text(text.replace("shards = 2", "shards = 3"), encoding="utf-8")
    site.fleet.process.send_signal(signal.SIGHUP)

    def settled() -> bool:
        shards = site.shards().values()
        return len(shards) == 3 and sum(shard["zones"] for shard in shards) == len(ROOMS) + 3

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
    workers = [pid for pid in frozen.frozen if _runs(pid, b"ray::Actor")]
    until(lambda: not any(_runs(pid, b"ray::Actor") for pid in workers), "the members of the frozen machine to end")
    now = _boots(site)
    assert {name: now[name] for name in on_it} == {name: before[name] for name in on_it}


def _boots(site: Site) -> dict[str, str]:
    return {name: shard["boot"] for name, shard in site.shards().items()}


def _runs(pid: int, word: bytes) -> bool:
    with suppress(OSError):
        return word in Path(f"/proc/{pid}/cmdline").read_bytes()
    return False


def test_everything_goes_on_while_the_head_of_the_cluster_does_not_answer(site: Site) -> None:
    (head,) = [pid for pid in site.cluster.head.pids() if _runs(pid, b"gcs_server")]
    urls, since = site.fleet.urls(), site.samples()
    os.kill(head, signal.SIGSTOP)
    try:
        time.sleep(3.0)
        for url in urls:
            assert set(site.zones(url)) >= set(ROOMS)
        until(lambda: site.goes_on(since), "new samples of every room")
    finally:
        os.kill(head, signal.SIGCONT)


def test_a_database_that_goes_away_is_waited_for(site: Site) -> None:
    before = _boots(site)
    site.database.stop()
    try:
        until(lambda: _posted(site, 20.5)[0] == 503, "a post that is not accepted")
        # Until every lease is over: nobody else can take one without the database either.
        time.sleep(1.5 * LEASE)
    finally:
        site.database.start()
    until(lambda: _posted(site, 20.5)[0] == 200, "a post that is accepted")
    since = site.samples()
    until(lambda: site.goes_on(since), "new samples of every room")
    assert _boots(site) == before, "no shard has to be started anew for it"


def _posted(site: Site, temperature: float, zone: str = POSTED) -> tuple[int, Any]:
    """The answer to readings of now."""
    lines = f"{zone} T_i={temperature},T_out=4.25,u_heat=900 {time.time_ns()}\n"
    return post_lines(f"{site.url()}/readings", lines, site.key)


def test_a_sample_that_ends_processes_is_passed_over(site: Site) -> None:
    since = site.samples()
    until(lambda: _posted(site, POISON, POISONED)[0] == 200, "the reading to be durable")
    skipped = f"SELECT skipped FROM \"thermogate_{SITE}\".samples WHERE zone = '{POISONED}' AND skipped IS NOT NULL"
    ((reason,),) = until(lambda: site.database.run(skipped), "the sample to be passed over")
    assert "3 processes ended while it was at work with its sample" in reason
    before = site.zones().get(POISONED, {"samples": 0})["samples"]

    def steps_again() -> bool:
        _posted(site, 21.5, POISONED)
        return bool(site.zones().get(POISONED, {"samples": 0})["samples"] > max(before, 1))

    until(steps_again, "the zone to go on without the sample")
    until(lambda: site.goes_on(since), "new samples of every room")
    status, forecast = site.get(f"/zones/{POISONED}/forecast")
    assert (status, forecast["zone"]) == (200, POISONED)


def test_a_live_source_reaches_its_zone_again_after_its_shard_was_lost(site: Site) -> None:
    def samples() -> int:
        for channel, value in MEASURED.items():
            site.session.put(f"plant/{channel}", str(value))
        return int(site.zones().get(LIVE, {"samples": 0})["samples"])

    since = samples()
    until(lambda: samples() > since + 1, "samples of the live zone")
    (shard,) = [one for one in site.shards().values() if LIVE in _zones_of(site, one["name"])]
    # A new process of the shard subscribes again.
    os.kill(shard["pid"], signal.SIGKILL)
    until(lambda: _boots(site).get(shard["name"], shard["boot"]) != shard["boot"], "a new process of the shard")
    since = samples()
    until(lambda: samples() > since + 1, "samples of the live zone")
    status, forecast = site.get(f"/zones/{LIVE}/forecast")
    assert status == 200, forecast
    assert {one["channel"]: one["value"] for one in forecast["inputs"]} == {
        name: MEASURED[name] for name in ("T_out", "u_heat")
    }


def test_a_gateway_has_the_configuration_read_again(site: Site) -> None:
    def reload() -> tuple[int, Any]:
        return post(f"{site.url()}/admin/reload", site.key)

    text = site.config.read_text(encoding="utf-8")
    site.config.write_text(f"{text}\nnonsense = 1\n", encoding="utf-8")
    status, refused = reload()
    assert (status, "nonsense" in refused["detail"]) == (409, True), refused
    site.config.write_text(text.replace(f"pace = {PACE}", "pace = 600.0"), encoding="utf-8")
    status, done = reload()
    assert (status, "changed" in done["done"]) == (200, True), done
    site.config.write_text(text, encoding="utf-8")
    assert reload()[0] == 200


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
                assert site.get(f"/zones/{room}/{path}") == (200, alone), f"{room}: {path}"
            assert len(alone) > 0


def test_a_report_is_made_of_what_the_database_holds(site: Site, tmp_path: Path) -> None:
    done = thermogate("report", "--fleet", "--config", site.config, "--zone", ROOMS[1], "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert ROOMS[1] in done.stdout
    assert "bit for bit" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_it_stops_in_order(site: Site) -> None:
    assert site.fleet.terminate() == 0, site.fleet.log()
    assert "stopped" in site.fleet.log()
    assert "Traceback" not in site.fleet.log()
