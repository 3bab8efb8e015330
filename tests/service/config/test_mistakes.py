"""Every mistake in a configuration is said in one sentence, with its exact place and a remedy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support.config_samples import sound, write
from support.config_spoiling import (
    AIR,
    LIVING,
    NETWORK,
    Change,
    Tables,
    air,
    at,
    check_mistake,
    inline,
    living,
    log,
    problems_of,
)

from service.config.load import load
from service.errors import ConfigError

# What is changed; where it must be reported; what must be said.
MISTAKES: dict[str, tuple[Change, str, tuple[str, ...]]] = {
    "unknown top-level key": (
        at(colour=1),
        "colour",
        ("not a known key", "site, log, http, zenoh, mqtt, fleet, sources, weather, zones"),
    ),
    "misspelt table": (at(zenho={"enabled": False}), "zenho", ("not a known key", 'did you mean "zenoh"?')),
    "unknown key in a table": (at("site", stat_dir="x"), "site.stat_dir", ('did you mean "state_dir"?',)),
    "unknown key in a zone": (living(perod="5min"), f"{LIVING}.perod", ('did you mean "period"?',)),
    "unknown key in a channel": (air(colum="x"), f"{AIR}.colum", ("not a known key", 'did you mean "column"?')),
    "unknown key in a source": (log(file="a"), "sources.log.file", ('did you mean "files"?',)),
    "unknown key deep down": (
        at("sources", "log", "timestamp", colum="x"),
        "sources.log.timestamp.colum",
        ("column, format, zone",),
    ),
    "no site": (at(site=None), "site", ("is missing", "[site]")),
    "site is no table": (at(site=3), "site", ("must be a table with id", "not 3")),
    "no site id": (at("site", id=None), "site.id", ("is missing", '"htwg"')),
    "bad site id": (at("site", id="HTWG Konstanz"), "site.id", ('"HTWG Konstanz" cannot be an id', "lower-case")),
    "id too long": (at("site", id="a" * 65), "site.id", ("at most 64",)),
    "zone id with a slash": (living(id="a/b"), "zones[0] ('a/b').id", ('"a/b" cannot be an id',)),
    "zone id with a wildcard": (living(id="**"), "zones[0] ('**').id", ("cannot be an id",)),
    "no zone id": (living(id=None), "zones[0].id", ("is missing",)),
    "two zones with one id": (
        at("zones", 1, id="living"),
        "zones[1] ('living').id",
        ('"living" is already the id of zones[0]', "an id of its own"),
    ),
    "set-point without a unit": (
        living(setpoint={"source": "log", "column": "Bedroom"}),
        f"{LIVING}.setpoint.unit",
        ("is missing",),
    ),
    "set-point in watts": (
        living(setpoint={"source": "log", "column": "Bedroom", "unit": "W"}),
        f"{LIVING}.setpoint.unit",
        ("degC",),
    ),
    "set-point of an unknown source": (
        living(setpoint={"source": "logg", "column": "Bedroom", "unit": "degC"}),
        f"{LIVING}.setpoint.source",
        ('did you mean "log"?',),
    ),
    "set-point in a missing column": (
        living(setpoint={"source": "log", "column": "Wanted", "unit": "degC"}),
        "sources.log",
        ("Wanted",),
    ),
    "set-point with a forecast": (
        living(
            setpoint={
                "source": "log",
                "column": "Bedroom",
                "unit": "degC",
                "forecast": {"source": "sky", "series": "t"},
            }
        ),
        f"{LIVING}.setpoint.forecast",
        ("nothing is forecast of a set-point", "remove it"),
    ),
    "no zones": (at(zones=None), "zones", ("there is no zone", "[[zones]]")),
    "empty zones": (at(zones=[]), "zones", ("there is no zone",)),
    "zones in single brackets": (at(zones={"id": "a"}), "zones", ("double brackets, [[zones]]",)),
    "zones is a number": (at(zones=5), "zones", ("[[zones]] tables", "not 5")),
    "a zone is no table": (lambda tables: tables["zones"].append(3), "zones[2]", ("[[zones]] table", "not 3")),
    "no sources": (at(sources=None), "sources", ("is missing", "[sources.recording]")),
    "sources is a list": (at(sources=[1]), "sources", ("must be tables, not [1]",)),
    "source is no table": (at("sources", log="a.csv"), "sources.log", ("must be a table", 'not "a.csv"')),
    "source without kind": (log(kind=None), "sources.log.kind", ("is missing", "one of: bacnet, csv")),
    "unknown kind": (log(kind="modbuss"), "sources.log.kind", ('no source of kind "modbuss"', "csv")),
    "kind is a list": (log(kind=["csv"]), "sources.log.kind", ("no source of kind", '["csv"]')),
    "bad source name": (
        lambda tables: (
            tables["sources"].update({"My log": tables["sources"]["log"]}),
            air(source="My log")(tables),
        ),
        'sources."My log"',
        ('"My log" cannot be an id',),
    ),
    "files is a text": (log(files="a.csv"), "sources.log.files", ("must be the list of files", 'not "a.csv"')),
    "no files": (log(files=[]), "sources.log.files", ("must be the list of files",)),
    "a file is a number": (log(files=["log.csv", 3]), "sources.log.files[1]", ("must be a text in quotes, not 3",)),
    "no timestamp": (log(timestamp=None), "sources.log.timestamp", ("is missing", 'column = "Timestamp"')),
    "unknown time zone": (
        at("sources", "log", "timestamp", zone="Europe/Berln"),
        "sources.log.timestamp.zone",
        ('"Europe/Berln" is not a time zone', '"Europe/Berlin"'),
    ),
    "time zone that is a folder": (
        at("sources", "log", "timestamp", zone="Europe"),
        "sources.log.timestamp.zone",
        ('"Europe" is not a time zone',),
    ),
    "time zone that climbs": (
        at("sources", "log", "timestamp", zone="../../etc/passwd"),
        "sources.log.timestamp.zone",
        ("is not a time zone",),
    ),
    "timestamp format without a pattern": (
        at("sources", "log", "timestamp", format="DD.MM.YYYY"),
        "sources.log.timestamp.format",
        ("DD.MM.YYYY", "%d.%m.%Y"),
    ),
    "bad pace": (log(pace="fast"), "sources.log.pace", ('"max"', "multiple of real time", 'not "fast"')),
    "pace of zero": (log(pace=0), "sources.log.pace", ("above 0",)),
    "long delimiter": (log(delimiter=";;"), "sources.log.delimiter", ("one character", 'not ";;"')),
    "delimiter is the decimal mark": (log(decimal=","), "sources.log", ("delimiter and decimal are both",)),
    "bad decimal": (log(decimal="'"), "sources.log.decimal", ('must be "." or ",", not',)),
    "a codec that makes no text": (log(encoding="hex"), "sources.log.encoding", ('"hex" is not a text encoding',)),
    "unknown encoding": (log(encoding="utf-9"), "sources.log.encoding", ('"utf-9" is not a text encoding',)),
    "a range beyond anything": (air(valid=[-1e300, 1e300]), f"{AIR}.valid", ("goes beyond", "-273.15 to 10000")),
    "non-loopback host": (
        at(http={"host": "0.0.0.0"}),
        "http",
        ('"0.0.0.0" lets other machines in', "certificate and private_key", "behind_tls_proxy = true", "127.0.0.1"),
    ),
    "host by name": (at(http={"host": "plant-pc"}), "http", ('"plant-pc" lets other machines in',)),
    "no host": (at(http={"host": "http://x"}), "http.host", ("neither an IP address nor the name",)),
    "certificate alone": (at(http={"certificate": "a.pem"}), "http", ("certificate and private_key belong together",)),
    "client certificates without one": (at(http={"client_ca": "ca.pem"}), "http", ("needs certificate and",)),
    "socket and port": (at(http={"socket": "x.sock", "port": 0}), "http", ("takes the place of host and port",)),
    "proxy by name": (at(http={"trusted_proxies": ["proxy"]}), "http.trusted_proxies[0]", ("not an IP address",)),
    "limit of nothing": (at(http={"limits": {"connections": 0}}), "http.limits.connections", ("from 1 to",)),
    "unknown limit": (at(http={"limits": {"conections": 9}}), "http.limits.conections", ('mean "connections"?',)),
    "limit of time": (at(http={"limits": {"send_timeout": 0}}), "http.limits.send_timeout", ("longer than 0",)),
    "port in quotes": (at(http={"port": "80"}), "http.port", ("whole number from 0 to 65535", 'not "80"')),
    "port too large": (at(http={"port": 65536}), "http.port", ("not 65536",)),
    "non-loopback listen": (
        at(zenoh={"listen": ["tcp/127.0.0.1:7447", "tcp/192.168.1.5:7447"]}),
        "zenoh",
        ('"tcp/192.168.1.5:7447", which is not a loopback address', "users_file"),
    ),
    "listen on every IPv6 address": (at(zenoh={"listen": ["tcp/[::]:7447"]}), "zenoh", ("lets other machines in",)),
    "listen to a multicast group": (at(zenoh={"listen": ["udp/[ff02::1]:7447"]}), "zenoh.listen[0]", ("multicast",)),
    "listen with TLS and no certificate": (at(zenoh={"listen": ["tls/127.0.0.1:7447"]}), "zenoh", ("tls.certificate",)),
    "listen to strangers on TLS": (
        at(zenoh={"listen": ["tls/0.0.0.0:7447"], "tls": {"certificate": "a.pem", "private_key": "a.key"}}),
        "zenoh",
        ("tls.ca", "mutual = true"),
    ),
    "password in the file": (at(zenoh={"user": "x", "password": "hush"}), "zenoh.password", ("not a known key",)),
    "password file that is not there": (
        at(zenoh={"user": "x", "password_file": "gone"}),
        "zenoh",
        ("password_file: ", "cannot be read"),
    ),
    "listen with a hidden interface": (
        at(zenoh={"listen": ["tcp/127.0.0.1:7447#iface=eth0"]}),
        "zenoh.listen[0]",
        ("is not an endpoint",),
    ),
    "bad endpoint": (at(zenoh={"connect": ["127.0.0.1"]}), "zenoh.connect[0]", ("protocol/host:port",)),
    "bad mode": (at(zenoh={"mode": "pear"}), "zenoh.mode", ('must be "peer", "client" or "router", not "pear"',)),
    "client without a router": (at(zenoh={"mode": "client"}), "zenoh", ("needs a router", "connect")),
    "enabled in quotes": (at(zenoh={"enabled": "yes"}), "zenoh.enabled", ("true or false", 'not "yes"')),
    "bad duration": (
        living(hold_inputs="5 minutes"),
        f"{LIVING}.hold_inputs",
        ('"5 minutes" is not a duration', "5min"),
    ),
    "negative duration": (living(lateness=-1), f"{LIVING}.lateness", ("-1 is not a duration",)),
    "no history": (at("site", keep_history=0), "site.keep_history", ("longer than 0",)),
    "size in words": (at("site", max_journal="2 gigabytes"), "site.max_journal", ("is not a size", '"2GB"')),
    "room number without quotes": (living(id=101), "zones[0].id", ("must be a text in quotes", "not 101")),
    "endless size": (at("site", max_journal=f"{'9' * 400}GB"), "site.max_journal", ("is not a size",)),
    "huge journal": (at("site", max_journal="9999999999TB"), "site.max_journal", ("at most 4000000TB",)),
    "more than a century": (at("site", keep_history="40000d"), "site.keep_history", ("up to a century",)),
    "tiny journal": (at("site", max_journal="1MB"), "site.max_journal", ("at least 16MB",)),
    "negative size": (at("site", max_journal=-5), "site.max_journal", ("is not a size",)),
    "checkpoint never": (at("site", checkpoint_every=0), "site.checkpoint_every", ("longer than 0",)),
    "period that does not divide a day": (
        living(period="7min"),
        f"{LIVING}.period",
        ('"7min" does not divide a day', "6min or 10min"),
    ),
    "period of two days": (living(period="2d"), f"{LIVING}.period", ("does not divide a day",)),
    "period of half a second": (living(period=0.5), f"{LIVING}.period", ("whole seconds", "for example 1s")),
    "period of zero": (living(period=0), f"{LIVING}.period", ("longer than 0",)),
    "negative period": (living(period="-5min"), f"{LIVING}.period", ('"-5min" is not a duration',)),
    "no period": (living(period=None), f"{LIVING}.period", ("is missing", "sampling period")),
    "level of one": (living(levels=[0.5, 1.0]), f"{LIVING}.levels[1]", ("between 0 and 1", "not 1.0")),
    "level in percent": (living(levels=[95]), f"{LIVING}.levels[0]", ("between 0 and 1", "not 95")),
    "no levels": (living(levels=[]), f"{LIVING}.levels", ("must be a list of levels",)),
    "level twice": (living(levels=[0.9, 0.9]), f"{LIVING}.levels", ("[0.9, 0.9] lists the same level twice",)),
    "negative seed": (living(seed=-1), f"{LIVING}.seed", ("whole number from 0",)),
    "fraction of a gap": (living(max_gap=1.5), f"{LIVING}.max_gap", ("whole number", "not 1.5")),
    "channel without source": (air(source=None), f"{AIR}.source", ("is missing", "[sources.<name>]")),
    "unknown source": (air(source="logg"), f"{AIR}.source", ('no source "logg"', 'did you mean "log"?')),
    "channel the network does not have": (
        at("zones", 0, "channels", T_adj={"source": "log", "column": "Bedroom", "unit": "degC"}),
        f"{LIVING}.channels.T_adj",
        ('"tite" has no such channel', "T_i, T_out, u_heat"),
    ),
    "missing channel": (
        at("zones", 0, "channels", T_out=None),
        f"{LIVING}.channels.T_out",
        ("is missing", 'T_out = { source = "...", column = "...", unit = "degC" }'),
    ),
    "no channels": (living(channels=None), f"{LIVING}.channels", ("is missing",)),
    "channels is a list": (living(channels=["T_i"]), f"{LIVING}.channels", ("must be a table", 'not ["T_i"]')),
    "channel is a text": (at("zones", 0, "channels", T_i="Temp2"), AIR, ("must be a table with source", 'not "Temp2"')),
    "wrong dimension": (air(unit="kW"), f"{AIR}.unit", ("'kW' cannot be converted to degC", "degC, K, degF")),
    "unknown unit": (
        at("zones", 0, "channels", "u_heat", unit="kilowatt"),
        f"{LIVING}.channels.u_heat.unit",
        ("'kilowatt' cannot be converted to W", "kW"),
    ),
    "no unit": (air(unit=None), f"{AIR}.unit", ("is missing", '"degC"')),
    "no column": (air(column=None), AIR, ("either column", "columns")),
    "column and columns": (air(columns=["a"]), AIR, ("either column",)),
    "empty columns": (air(column=None, columns=[]), AIR, ("either column",)),
    "columns is a text": (air(column=None, columns="a"), f"{AIR}.columns", ("must be a list of columns",)),
    "scale of zero": (air(scale=0), f"{AIR}.scale", ("must not be 0",)),
    "scale in quotes": (air(scale="2"), f"{AIR}.scale", ("must be a number, without quotes", 'not "2"')),
    "valid reversed": (air(valid=[50, -30]), f"{AIR}.valid", ("[50.0, -30.0] is reversed", "smaller number first")),
    "valid is one number": (air(valid=[50]), f"{AIR}.valid", ("two numbers",)),
    "valid is three numbers": (air(valid=[0, 1, 2]), f"{AIR}.valid", ("two numbers",)),
    "unknown aggregate": (air(aggregate="meen"), f"{AIR}.aggregate", ('"meen" is not known', 'did you mean "mean"?')),
    "unknown estimator": (living(estimator="rpbf"), f"{LIVING}.estimator", ('no estimator "rpbf"', "rbpf")),
    "unknown estimator option": (
        living(estimator_options={"particels": 10}),
        f"{LIVING}.estimator_options.particels",
        ("particels", "particles"),
    ),
    "bad option value": (
        living(estimator_options={"gate_min": 0.1, "particles": -5}),
        f"{LIVING}.estimator_options.particles",
        ("particles", "-5"),
    ),
    "options is a list": (living(estimator_options=[1]), f"{LIVING}.estimator_options", ("must be a table",)),
    "missing file": (log(files=["gone.csv"]), "sources.log", ("gone.csv' cannot be read", "check its path")),
    "file is a folder": (log(files=["."]), "sources.log", ("cannot be read",)),
    "missing column": (
        air(column="Livin"),
        "sources.log",
        ("log.csv' has no column 'Livin' (channel living/T_i)", "Living, Bedroom"),
    ),
    "missing timestamp column": (
        at("sources", "log", "timestamp", column="Time"),
        "sources.log",
        ("no column 'Time' (the timestamp)",),
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistake_is_one_sentence_at_its_place(name: str, tmp_path: Path) -> None:
    check_mistake(tmp_path, *MISTAKES[name])


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_not_followed_by_others_that_it_caused(name: str, tmp_path: Path) -> None:
    assert len(problems_of(tmp_path, MISTAKES[name][0])) == 1


def test_all_mistakes_are_found_at_once(tmp_path: Path) -> None:
    def change(tables: Tables) -> None:
        at(colour=1)(tables)
        at("site", id="A")(tables)
        log(pace="fast")(tables)
        living(period="7min", network="nope")(tables)
        air(unit="furlong", source="elsewhere")(tables)
        at("zones", 1, levels=[2])(tables)
        at("zones", 1, "channels", "T_i", unit="furlong", aggregate="meen")(tables)
        at("zones", 1, "network", fixed=["C_x"])(tables)

    found = problems_of(tmp_path, change)

    bedroom = "zones[1] ('bedroom')"
    assert sorted(problem.split(": ")[0] for problem in found) == sorted(
        [
            "colour",
            "site.id",
            "sources.log.pace",
            f"{LIVING}.period",
            NETWORK,
            f"{AIR}.source",
            f"{bedroom}.levels[0]",
            f"{bedroom}.channels.T_i.aggregate",
            f"{bedroom}.channels.T_i.unit",
            f"{bedroom}.network.fixed[0]",
        ]
    )


def test_several_bad_options_are_each_reported(tmp_path: Path) -> None:
    options = {"particles": 1, "gate_low": 7, "particels": 3, "preset": "paper"}

    found = problems_of(tmp_path, living(estimator_options=options))

    places = {problem.split(": ")[0] for problem in found}
    assert places == {f"{LIVING}.estimator_options.{name}" for name in ("particles", "gate_low", "particels")}


def test_options_that_only_clash_together_are_reported_once(tmp_path: Path) -> None:
    found = problems_of(tmp_path, living(estimator_options={"gate_low": 0.8, "gate_high": 0.7}))

    assert len(found) == 1
    assert "gate_low = 0.8 must be below gate_high = 0.7" in found[0]


def test_every_unreadable_file_is_reported(tmp_path: Path) -> None:
    found = problems_of(tmp_path, log(files=["log.csv", "b.csv", "c.csv.gz"]))

    assert [name in problem for name, problem in zip(("b.csv", "c.csv.gz"), found, strict=True)] == [True, True]


@pytest.mark.parametrize(
    ("content", "gist"),
    [
        (b'[site]\nid = "a\n', ("line 2, column", "not TOML")),
        (b"[site]\nid house\n", ("line 2, column 4", "not TOML", "expected '='")),
        (b"[site", ("the end of the file", "not TOML")),
        (b"[site]\n[site]\n", ("line 2", "not TOML")),
        (b'[site]\nid = "B\xfcro"\n', ("line 2 is not UTF-8", "save the file as UTF-8")),
        (b"a = " + b"9" * 5000, ("not TOML",)),
        (b"", ("is missing",)),
    ],
)
def test_file_that_is_not_toml(content: bytes, gist: tuple[str, ...], tmp_path: Path) -> None:
    path = tmp_path / "house.toml"
    path.write_bytes(content)

    with pytest.raises(ConfigError) as caught:
        load(path)

    for words in gist:
        assert words in caught.value.problems[0]
    assert all("\n" not in problem for problem in caught.value.problems)


def test_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path / "gone.toml")

    (problem,) = caught.value.problems
    assert problem.startswith(f"{tmp_path / 'gone.toml'}: cannot be read (no such file")


def test_file_that_is_a_folder(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path)

    (problem,) = caught.value.problems
    assert problem.startswith(f"{tmp_path}: cannot be read (it is a folder)")


@pytest.mark.parametrize("value", [10**400, float("nan"), float("inf"), -5, True, "abc", [], {}])
def test_no_value_of_any_type_gets_past_a_number(value: object, tmp_path: Path) -> None:
    found = problems_of(tmp_path, living(hold_inputs=value))

    assert found[0].startswith(f"{LIVING}.hold_inputs: ")


JUNK: list[object] = [5, -1.5, True, "junk", "", [], ["junk"], [[]], {}, {"junk": {"junk": 1}}, [{}]]


@pytest.mark.parametrize("junk", JUNK, ids=repr)
def test_junk_anywhere_is_refused_in_sentences_or_accepted(junk: object, tmp_path: Path) -> None:
    """No value of a wrong type anywhere escapes as another exception than ConfigError."""
    for change in _everywhere(_explicit(tmp_path), junk):
        tables = _explicit(tmp_path)
        change(tables)
        for problem in _outcome(write(tmp_path, tables)):
            assert ": " in problem
            assert "\n" not in problem


def _explicit(folder: Path) -> Tables:
    """The sound tables with an inline network and some options written out."""
    tables = sound(folder)
    inline()(tables)
    tables["zones"][1]["estimator_options"] = {"preset": "paper", "particles": 100, "coordinates": "log"}
    tables["zones"][1]["network"] |= {"fixed": ["C_h"], "parameters": {"C_i": {"value": 1e6}}, "initial": {"T_e": {}}}
    return tables


def _outcome(path: Path) -> list[str]:
    try:
        load(path)
    except ConfigError as error:
        return error.problems
    return []


def _everywhere(tables: Any, junk: object, keys: tuple[str | int, ...] = ()) -> list[Change]:
    changes: list[Change] = []
    for key, value in tables.items() if isinstance(tables, dict) else enumerate(tables):
        changes.append(_replacing((*keys, key), junk))
        if isinstance(value, dict | list):
            changes += _everywhere(value, junk, (*keys, key))
    return changes


def _replacing(keys: tuple[str | int, ...], junk: object) -> Change:
    def change(tables: Tables) -> None:
        table: Any = tables
        for key in keys[:-1]:
            table = table[key]
        table[keys[-1]] = junk

    return change


def test_control_characters_of_a_file_do_not_reach_the_terminal(tmp_path: Path) -> None:
    (problem,) = problems_of(tmp_path, at("site", id="a\x1b[2J\n\u2028b"))

    assert problem.startswith('site.id: "a\\x1b[2J\\n\\u2028b" cannot be an id')
    assert problem.isprintable()
