"""The history of Home Assistant, from databases of its schema."""

import asyncio
import sqlite3
from contextlib import closing

import pytest
from support.recorder import BEGIN, database
from support.sources import bound, delivered, source_table

from adapters.errors import SourceConfigError, SourceUnavailable

ROOM = ("sensor.room",)


def source(path, *entities, data="states", **keys):
    table = source_table("home-assistant", file=path, data=data)
    keys = {"unit": "degC", "valid": (-1e9, 1e9)} | keys
    return table.build(
        "home", [bound(table, entity, entity=entity, attribute=(*more, None)[0], **keys) for entity, *more in entities]
    )


def readings(path, *entities, start=None, **settings):
    """Seconds since BEGIN and value of every reading."""
    return delivered(source(path, *entities, **settings), start, BEGIN)


def test_a_state_holds_until_the_next_one_and_is_read_again_every_minute(tmp_path):
    path = database(
        tmp_path / "db", [(10, "sensor.room", "20.5"), (130, "sensor.room", "21"), (200, "sensor.sun", "1")]
    )
    assert readings(path, ROOM) == [(10, 20.5), (60, 20.5), (120, 20.5), (130, 21.0), (180, 21.0)]
    assert readings(path, ROOM, start=BEGIN + 125) == [(130, 21.0), (180, 21.0)]
    (probe,) = asyncio.run(source(path, ROOM).probe(1.0))
    assert (probe.value, probe.time, probe.place) == (21.0, BEGIN + 130, "sensor.room")
    assert readings(path, ("sensor.other",)) == []


def test_nothing_is_written_beside_a_copy_that_had_a_write_ahead_log(tmp_path):
    path = database(tmp_path / "db", [(0, "sensor.room", "20.5"), (60, "sensor.sun", "1")])
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA journal_mode = wal")
    assert readings(path, ROOM) == [(0, 20.5)]
    assert list(tmp_path.iterdir()) == [path]


def test_what_is_no_number_is_missing_and_ends_what_held(tmp_path):
    rows = [(0, "sensor.room", "20"), (60, "sensor.room", "unavailable"), (300, "sensor.room", "19"), (310, "a.b", "1")]
    assert readings(database(tmp_path / "db", rows), ROOM) == [(0, 20.0), (300, 19.0)]


def test_nothing_holds_while_the_recorder_did_not_run(tmp_path):
    rows = [(0, "sensor.room", "20"), (7200, "sensor.room", "18"), (7260, "a.b", "1")]
    path = database(tmp_path / "db", rows, runs=((0, 100), (7200, None)))
    assert readings(path, ROOM) == [(0, 20.0), (60, 20.0), (7200, 18.0)]


def test_attributes_and_words(tmp_path):
    rows = [
        (0, "climate.room", ("heat", '{"current_temperature": 19.5, "hvac_action": "heating"}')),
        (60, "climate.room", ("heat", '{"current_temperature": 20.0, "hvac_action": "idle"}')),
        (120, "climate.room", ("heat", '{"current_temp')),
        (180, "climate.room", ("heat", "[]")),
        (240, "a.b", "1"),
    ]
    path = database(tmp_path / "db", rows)
    assert readings(path, ("climate.room", "current_temperature")) == [(0, 19.5), (60, 20.0)]
    assert readings(path, ("climate.room", "hvac_action")) == [(0, 1.0), (60, 0.0)]
    assert readings(path, ("climate.room", "swing_mode")) == []


def test_a_thermostat_that_cools_does_not_heat(tmp_path):
    actions = ("preheating", "cooling", "defrosting", "fan", "off", "sleeping")
    rows = [(60 * m, "climate.room", ("auto", f'{{"hvac_action": "{action}"}}')) for m, action in enumerate(actions)]
    path = database(tmp_path / "db", [*rows, (600, "a.b", "1")])
    assert readings(path, ("climate.room", "hvac_action"))[:5] == [(60 * m, float(m == 0)) for m in range(5)]


def test_a_meter_becomes_power_from_one_change_to_the_next(tmp_path):
    rows = [(0, "sensor.energy", "10.0"), (3600, "sensor.energy", "10.5"), (7200, "sensor.energy", "12.5")]
    found = readings(database(tmp_path / "db", rows), ("sensor.energy",), unit="kWh", to="W")
    assert found == [(0, pytest.approx(500.0)), (3600, pytest.approx(2000.0))]


def test_hourly_statistics_hold_for_their_hour(tmp_path):
    path = database(tmp_path / "db", [], statistics=[(0, "sensor.room", 20.25, None), (2, "sensor.room", 21.0, None)])
    found = readings(path, ROOM, data="statistics")
    assert len(found) == 120
    assert found[0] == (0, 20.25)
    assert found[59:61] == [(3540, 20.25), (7200, 21.0)]


def test_check_names_what_is_missing_and_what_is_in_another_unit(tmp_path):
    path = database(tmp_path / "db", [(0, "sensor.room", "68")], attributes='{"unit_of_measurement": "°F"}')
    assert source(path, ROOM, unit="degF").check() == []
    assert source(path, ROOM).check() == [
        'sources.home: \'sensor.room\' is in °F; write unit = "degF" instead of "degC"'
    ]
    (problem,) = source(path, ("sensor.rom",)).check()
    assert problem.endswith("has no states of 'sensor.rom'; did you mean sensor.room?")


def test_what_is_no_database_of_home_assistant_is_refused_in_a_sentence(tmp_path):
    (tmp_path / "text").write_text("no database at all, but long enough to be taken for one")
    with closing(sqlite3.connect(tmp_path / "other")) as connection:
        connection.execute("CREATE TABLE states (a)")
    for name, error, sentence in (
        ("missing", SourceUnavailable, "is not there"),
        ("text", SourceUnavailable, "cannot be read as a database"),
        ("other", SourceConfigError, "has no table states_meta"),
    ):
        (problem,) = source(tmp_path / name, ROOM).check()
        assert sentence in problem
        with pytest.raises(error, match=sentence):
            readings(tmp_path / name, ROOM)
