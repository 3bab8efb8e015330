"""Histories in databases of time series, read from a real Prometheus, VictoriaMetrics and InfluxDB."""

import asyncio
import subprocess
import time
from datetime import UTC, datetime
from unittest.mock import Mock

import pytest
from support import influx
from support.processes import free_port, program
from support.sources import bound, delivered, source_table
from support.waiting import wait_until
from support.web_answers import answering

from adapters.errors import SourceConfigError, SourceError, SourceUnavailable
from adapters.series.database import parts

BEGIN = int(time.time() - 2 * 86400) // 7200 * 7200
"""UTC s: Prometheus keeps blocks of two hours, and two weeks of them."""

MINUTES = 180
ROOMS = [
    (room, minute, level + 0.01 * minute)
    for room, level in (("101", 20.0), ("102", 22.0))
    for minute in range(MINUTES)
    if not 60 <= minute < 90
]
"""Room, minutes since BEGIN and temperature."""


def source(database, query, *, minutes=MINUTES, step=60.0, **keys):
    """What `query` gives of the table `database`, kind and keys."""
    begin, end = (datetime.fromtimestamp(BEGIN + 60 * at, UTC).isoformat() for at in (0, minutes))
    table = source_table(**database, begin=begin, end=end, step=step)
    return table.build("past", [bound(table, "room/T", query=query, **keys)])


def readings(*asked, start=None, **keys):
    """Minutes since BEGIN and value of every reading."""
    return [(seconds / 60, value) for seconds, value in delivered(source(*asked, **keys), start, BEGIN)]


def exposed(scale=1):
    """Two rooms and a meter as Prometheus writes them; `scale` is the times' per second."""
    rooms = [f'room_temperature{{room="{room}"}} {value:.2f} {scale * (BEGIN + 60 * at)}' for room, at, value in ROOMS]
    meter = [f"meter_total {0.01 * minute:.2f} {scale * (BEGIN + 60 * minute)}" for minute in range(MINUTES)]
    return "\n".join(["# TYPE room_temperature gauge", *rooms, "# TYPE meter counter", *meter, "# EOF", ""])


def of_prometheus(folder, port):
    (folder / "past.txt").write_text(exposed())
    (folder / "prometheus.yml").write_text("global: {}\n")
    made = ["promtool", "tsdb", "create-blocks-from", "openmetrics", folder / "past.txt", folder / "data"]
    subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
    command = ["prometheus", f"--config.file={folder / 'prometheus.yml'}", f"--storage.tsdb.path={folder / 'data'}"]
    return influx.serving([*command, f"--web.listen-address=127.0.0.1:{port}"], f"http://127.0.0.1:{port}/-/ready")


@pytest.fixture(scope="module", params=["prometheus", "victoria-metrics"])
def ranges(request, tmp_path_factory):
    """A database with range queries."""
    program(request.param, request.param)
    folder, port = tmp_path_factory.mktemp(request.param), free_port()
    table = {"kind": "prometheus", "url": f"http://127.0.0.1:{port}"}
    if request.param == "prometheus":
        with of_prometheus(folder, port):
            yield table
    else:
        with influx.victoria(folder, port):
            influx.answer(f"{table['url']}/api/v1/import/prometheus", exposed(1000).encode())
            wait_until(lambda: len(readings(table, "meter_total")) == MINUTES)
            yield table


@pytest.fixture(scope="module")
def influxdb(tmp_path_factory):
    with influx.server(tmp_path_factory.mktemp("influxdb"), free_port()) as table:
        lines = [f"degC,room={room} value={value:.2f} {BEGIN + 60 * minute}" for room, minute, value in ROOMS]
        lines += [
            f"kWh,room=101 value={0.01 * max(0, minute - 90):.2f} {BEGIN + 60 * minute}" for minute in range(MINUTES)
        ]
        influx.post(table, "/write", {"db": "house", "precision": "s"}, "\n".join(lines).encode())
        yield {"kind": "influxdb", "database": "house", **table}


def expected(first=0):
    return [(minute, round(20 + 0.01 * minute, 2)) for minute in range(first, MINUTES) if not 60 <= minute < 90]


def test_every_step_has_its_value_and_what_is_older_than_five_minutes_is_missing(ranges):
    found = readings(ranges, 'room_temperature{room="101"}')
    # A value counts for at most the five minutes after it.
    held = [(minute, 20.59) for minute in range(60, 65)]
    assert [pair for pair in found if pair not in held] == [(float(m), v) for m, v in expected()]
    assert readings(ranges, 'room_temperature{room="101"}', start=BEGIN + 6000.0) == [
        (float(minute), value) for minute, value in expected(100)
    ]
    assert readings(ranges, 'room_temperature{room="303"}') == []


def test_a_counter_becomes_power(ranges):
    found = readings(ranges, "meter_total", unit="kWh", to="W", minutes=5)
    assert found == [(float(minute), pytest.approx(600.0)) for minute in range(4)]


def test_several_series_and_wrong_expressions_are_refused_in_a_sentence(ranges):
    with pytest.raises(SourceConfigError, match=r"^sources\.past: .* gives 2 series .*add labels"):
        readings(ranges, "room_temperature")
    with pytest.raises(SourceConfigError, match="refuses the question"):
        readings(ranges, "room_temperature{")


def test_influxdb_gives_the_means_of_every_step(influxdb):
    query = '"value" FROM "degC" WHERE "room" = \'101\''
    assert readings(influxdb, query) == [(float(minute), pytest.approx(value)) for minute, value in expected()]
    assert readings(influxdb, query, step=600.0)[0] == (0.0, pytest.approx(20.045))
    assert readings(influxdb, '"value" FROM "degC" WHERE "room" = \'303\'') == []


def test_a_counter_in_influxdb_becomes_the_power_of_its_own_time(influxdb):
    found = dict(readings(influxdb, '"value" FROM "kWh"', unit="kWh", to="W", step=600.0))
    assert [found[minute] for minute in (70.0, 80.0, 90.0, 100.0)] == pytest.approx([0.0, 0.0, 600.0, 600.0])


def test_influxdb_refuses_in_a_sentence(influxdb, tmp_path):
    (tmp_path / "wrong").write_text("not it")
    stranger = influxdb | {"password_file": tmp_path / "wrong"}
    with pytest.raises(SourceConfigError, match="check user and password"):
        readings(stranger, '"value" FROM "degC"')
    elsewhere = influxdb | {"database": "castle"}
    with pytest.raises(SourceError, match="database not found"):
        readings(elsewhere, '"value" FROM "degC"')


def test_probe_shows_the_newest_value(ranges):
    (probe,) = asyncio.run(source(ranges, 'room_temperature{room="101"}', minutes=10).probe(1.0))
    assert (probe.value, probe.time, probe.verdict) == (20.09, BEGIN + 540, "good")


@pytest.mark.parametrize(
    "query",
    ["", '"value"', '"value" FROM ', ' FROM "degC"', '"v" FROM "degC"; DROP DATABASE h', '"v") into "c" FROM "d"'],
)
def test_a_query_of_another_form_is_refused(query):
    with pytest.raises(ValueError, match="must be of the form"):
        parts(query)


def test_an_error_that_breaks_off_is_told_by_its_reason(monkeypatch):
    monkeypatch.setattr("http.client.HTTPResponse.read", Mock(side_effect=ConnectionResetError))
    with answering(lambda *_: (503, b"busy")) as url, pytest.raises(SourceUnavailable, match="503 Service Unavail"):
        readings({"kind": "prometheus", "url": url}, "up")


def test_a_server_that_is_another_one():
    with answering(lambda path, _: (200, b"<html>" if "query_range" in path else b'{"results": 1}')) as url:
        other = {"kind": "prometheus", "url": url}
        with pytest.raises(SourceUnavailable, match="does not answer in JSON"):
            readings(other, "up")
        with pytest.raises(SourceUnavailable, match="something else than it documents"):
            readings(other | {"kind": "influxdb", "database": "house"}, '"value" FROM "degC"')
