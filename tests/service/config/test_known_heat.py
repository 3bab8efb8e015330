"""Sun and habits as a zone's table and the site say, and what a zone has of them that says nothing."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.config_samples import SUN, changed, learned, sound, write

from estimator.network.boxes import TYPICAL_AREA
from estimator.network.presets import automatic
from service.config.fitting import fingerprint, make_worker
from service.config.known_heat import usually_heated
from service.config.load import load
from service.config.site import Config
from service.config.written import effective_toml

Keys = dict[str, Any] | None
CLOUDY: dict[str, Any] = {"cloud_cover": {"source": "log", "column": "Sun", "unit": "%"}}
PLACE = {"latitude": 47.67, "longitude": 9.17, "time_zone": "Europe/Berlin"}


def loaded(folder: Path, site: dict[str, Any] | None = None, more: dict[str, Any] | None = None, **zone: Any) -> Config:
    """The sample with more in [site] and in the table of its first zone, and `more` channels, by default the sun."""
    return load(changed(folder, site, {"I_sol": SUN} if more is None else more, **zone))


def names(config: Config) -> set[str]:
    return {term.series.rpartition("_")[0] or term.series for term in config.zones[0].network.terms}


def test_an_automatic_zone_knows_habits_and_the_sun_as_far_as_it_can(tmp_path: Path) -> None:
    assert names(loaded(tmp_path, more={}, network="auto")) == {"habit", "habit_weekend"}
    assert names(loaded(tmp_path, network="auto")) == {"habit", "habit_weekend", "sun", "horizontal"}
    by_facade = names(loaded(tmp_path, PLACE, network="auto"))
    assert by_facade == {"habit", "habit_weekend", "east", "south", "west", "diffuse", "horizontal"}
    assert names(loaded(tmp_path, PLACE, network="auto", habits=False, sun=False)) == set()
    assert names(loaded(tmp_path, PLACE, CLOUDY, network="auto")) == {"habit", "habit_weekend", "clear"}


def test_clouds_are_those_of_a_sky_and_of_hours_ago(tmp_path: Path) -> None:
    told = {"cloud_cover": CLOUDY["cloud_cover"] | {"valid": [0, 90], "max_age": "2h"}}
    channels = [loaded(tmp_path, PLACE, more, network="auto").zones[0].channels for more in (CLOUDY, told)]
    found = [(one["cloud_cover"].valid, one["cloud_cover"].max_age) for one in channels]
    assert found == [((0.0, 100.0), 86400.0), ((0.0, 90.0), 7200.0)]


@pytest.mark.parametrize(("site", "more"), [(PLACE, None), ({}, None), (PLACE, {}), (PLACE, CLOUDY)])
def test_experiments_give_a_room_the_network_of_such_a_zone(site: Keys, more: Keys, tmp_path: Path) -> None:
    zone = loaded(tmp_path, site, more, network="auto").zones[0]
    assert usually_heated(automatic(zone.network.inputs), zone.whereabouts.location) == zone.network


def test_other_networks_and_estimators_know_what_is_asked_for(tmp_path: Path) -> None:
    assert names(loaded(tmp_path, more={})) == set()
    assert names(loaded(tmp_path, more={}, habits=True)) == {"habit", "habit_weekend"}
    assert names(loaded(tmp_path, network="auto", estimator="ekf")) == set()
    assert names(loaded(tmp_path, network={"preset": "titeth", "solar": True}, sun="hours")) == {"sun", "horizontal"}


def test_a_floor_area_scales_what_is_thought_before_the_first_sample(tmp_path: Path) -> None:
    plain, large = (
        loaded(tmp_path, PLACE, network="auto", **keys).zones[0].network
        for keys in ({}, {"floor_area": 3 * TYPICAL_AREA})
    )
    for one, other in zip(plain.terms, large.terms, strict=True):
        assert other.sd == pytest.approx(3 * one.sd)
    assert large.parameter("C_e").typical == pytest.approx(3 * plain.parameter("C_e").typical)
    boxed = {"preset": "auto", "box": {"floor_area": 3 * TYPICAL_AREA}}
    assert loaded(tmp_path, PLACE, network=boxed).zones[0].network.terms == large.terms


def test_a_zone_takes_from_the_site_what_it_does_not_say_of_the_building(tmp_path: Path) -> None:
    site = {"construction": "heavy", "built": 1950, "use": "dwelling"}
    own, plain = (
        loaded(tmp_path, known, network="auto", floor_area=30.0, **zone).zones[0]
        for known, zone in ((site, {"built": 2020, "use": "office"}), ({}, {}))
    )
    assert own.network.parameter("C_e").typical == pytest.approx(30.0 * 2.6e5)
    assert own.network.parameter("g_i_out").typical == pytest.approx(30.0 * 0.77)
    assert next(term.mean for term in own.network.terms if term.name == "habit_09") == pytest.approx(30.0 * 12.0)
    # A prior is no other network: state of before goes on.
    assert fingerprint(own) == fingerprint(plain)
    # What a site says in general is nothing to a network that it does not fit.
    assert loaded(tmp_path, site, network="building-67").zones[0].network.terms == ()


def test_a_zone_with_state_from_before_goes_on_without(tmp_path: Path) -> None:
    before = loaded(tmp_path, PLACE, network="auto", estimator="mkf", habits=False, sun=False)
    learned(before)
    now = loaded(tmp_path, PLACE, network="auto", estimator="mkf")
    assert fingerprint(now.zones[0]) == fingerprint(before.zones[0])
    assert now.zones[0].network.terms == ()
    # Asked for, it is another network, whose state has to be begun with --reset.
    asked = loaded(tmp_path, PLACE, network="auto", estimator="mkf", habits=True)
    assert fingerprint(asked.zones[0]) != fingerprint(before.zones[0])


def test_a_zone_that_learned_the_sun_by_the_hour_goes_on_so_when_the_site_gets_a_location(tmp_path: Path) -> None:
    before = loaded(tmp_path, network="auto", estimator="mkf")
    learned(before)
    now = loaded(tmp_path, PLACE, network="auto", estimator="mkf")
    assert fingerprint(now.zones[0]) == fingerprint(before.zones[0])
    assert "sun_12" in now.zones[0].network.drive


def test_the_worker_knows_the_heat_of_its_zone(tmp_path: Path) -> None:
    worker = make_worker(loaded(tmp_path, PLACE, network="auto", estimator="mkf").zones[0])
    afternoon = np.array([1371560400.0])  # 18 June 2013, 15:00 in Berlin
    (row,) = worker.loop.driving(afternoon, np.array([[10.0, 0.0, 700.0]]))
    known = dict(zip(worker.network.drive, row.tolist(), strict=True))
    assert known["sun_west"] > known["sun_east"] == 0.0
    assert known["habit_15"] == pytest.approx(1 - 2.5 / 60 / 3)
    assert known["habit_weekend_15"] == 0.0


def shared(folder: Path, share: str | float = "boiler", **living: Any) -> Config:
    """The sample in which both zones read one heat meter."""
    tables = sound(folder)
    for zone in tables["zones"]:
        zone["channels"]["u_heat"]["share"] = share
    tables["zones"][0] |= living
    return load(write(folder, tables))


def test_zones_that_read_one_meter_have_equal_shares_or_those_of_their_floors(tmp_path: Path) -> None:
    def likely(config: Config) -> list[float | None]:
        return [zone.network.parameter("share_u_heat").typical for zone in config.zones]

    equal = shared(tmp_path)
    assert likely(equal) == [0.5, 0.5]
    assert likely(shared(tmp_path, floor_area=30.0)) == [0.5, 0.5], "the floor area of the other is not known"
    tables = sound(tmp_path)
    for zone, area in zip(tables["zones"], (30.0, 10.0), strict=True):
        zone["channels"]["u_heat"]["share"], zone["floor_area"] = "boiler", area
    assert likely(load(write(tmp_path, tables))) == [0.75, 0.25]
    few = shared(tmp_path, 0.2)
    assert likely(few) == [0.2, 0.2]
    assert [fingerprint(zone) for zone in few.zones] == [fingerprint(zone) for zone in equal.zones], "state is kept"
    (tmp_path / "again.toml").write_text(effective_toml(equal), encoding="utf-8")
    again = load(tmp_path / "again.toml")
    assert [fingerprint(zone) for zone in again.zones] == [fingerprint(zone) for zone in equal.zones]
    assert likely(again) == [0.5, 0.5]
