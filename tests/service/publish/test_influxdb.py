"""What zones announce as line protocol: read by another parser, a real InfluxDB and a real VictoriaMetrics."""

import json
import logging
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from line_protocol_parser import parse_line
from support import influx
from support.fake_zones import announced, make_update, running
from support.processes import free_port
from support.waiting import wait_until

from adapters.fields.times import parse_time
from adapters.payload.line_protocol import points
from service.publish import influxdb
from service.publish.influxdb import KIND, LinesConfig, Writer, lines_of
from service.publish.sinks import Announcement, Occasion, Reports


def everything(step: int = 2) -> Announcement:
    zone = running("living")
    reports = Reports(zone.skill(), trust=zone.now().trust)
    return Announcement("htwg", "living", zone.now()._replace(update=make_update(step)), Occasion.UPDATE, reports)


def opened(**keys: Any) -> Writer:
    sink = KIND.open(LinesConfig.model_validate(keys, context={"folder": Path("/")}), "htwg")
    assert isinstance(sink, Writer)
    return sink


@pytest.fixture
def sink(tmp_path: Path) -> Iterator[Writer]:
    """A sink that writes into the file `lines`."""
    sink = opened(file=tmp_path / "lines")
    yield sink
    sink.close()


def dropped(sink: Writer) -> float:
    ((_, value),) = sink.measures()[1].read()
    return value


def seconds(document: dict[str, Any], key: str) -> float:
    return parse_time(document[key]).timestamp()


def test_every_topic_is_read_by_ours_and_by_another_parser() -> None:
    announcement = everything()
    for topic in announcement.topics:
        lines = list(lines_of(topic, announcement.payload(topic), 0.0))
        assert lines
        theirs = [parse_line(line.strip()) for line in lines]
        for line, their in zip(lines, theirs, strict=True):
            ours = list(points(line))
            assert {point.field: point.value for point in ours} == their["fields"]
            assert (ours[0].measurement, ours[0].tags) == (their["measurement"], their["tags"])
        # A second value of the same series and time would take the place of the first.
        series = [(one["measurement"], tuple(sorted(one["tags"].items())), one["time"]) for one in theirs]
        assert len(set(series)) == len(series)


def test_names_and_numbers_are_those_of_the_documents() -> None:
    announcement = everything()
    told = json.loads(announcement.payload("forecast"))
    lines = list(lines_of("forecast", json.dumps(told).encode(), 0.0))
    values = {(point.measurement, *sorted(point.tags.values()), point.field): point for point in points("".join(lines))}
    mean = values["thermogate_forecast_outputs", "T_air", "htwg", "living", "mean"]
    assert (mean.value, mean.time) == (told["mean"], seconds(told, "valid_time"))
    lower = values["thermogate_forecast_outputs_intervals", "0.95", "T_air", "htwg", "living", "lower"]
    assert lower.value == told["intervals"][0]["lower"]
    assert values["thermogate_forecast", "T_air", "htwg", "living", "volatility_median"].value == 1.1300705799504274
    assert values["thermogate_forecast", "T_air", "htwg", "living", "quality"].value == "good"
    status = json.loads(announcement.payload("status"))
    (state, *_) = lines_of("status", json.dumps(status).encode(), 0.0)
    assert parse_line(state)["time"] == round(seconds(status, "last_sample_time") + status["age_s"]) * 10**9


def test_what_has_a_meaning_in_line_protocol_arrives_as_it_was() -> None:
    odd = {"zone": "a b,c=d", "finding": "x\\", "sentence": 'say "so" \\ and,\nthen = end', "empty": "", "none": None}
    (line,) = lines_of("status", json.dumps({"zone": "a b,c=d", "findings": [odd]}).encode(), 60.0)
    found = {point.field: point for point in points(line)}
    assert found.keys() == {"sentence", "empty"}
    assert found["sentence"].value == odd["sentence"]
    assert (found["sentence"].tags["zone"], found["sentence"].time) == (odd["zone"], 60.0)


def test_a_file_is_added_to_and_may_be_moved_away(sink: Writer, tmp_path: Path) -> None:
    lines, moved = tmp_path / "lines", tmp_path / "lines.1"
    lines.write_text("earlier value=1\n")
    sink.publish(everything())
    wait_until(lambda: "thermogate_status" in lines.read_text())
    lines.rename(moved)
    sink.publish(everything(3))
    wait_until(lambda: lines.exists() and "thermogate_status" in lines.read_text())
    assert moved.read_text().startswith("earlier value=1\n")
    assert lines.read_text() == "".join(
        line for topic in everything(3).topics for line in lines_of(topic, everything(3).payload(topic), 0.0)
    )


def test_a_forecast_that_nobody_vouches_for_any_more_is_written_again_as_bad(sink: Writer, tmp_path: Path) -> None:
    failed = running("living").now().status._replace(state="failed")
    sink.publish(announced("living", make_update(2), failed, Occasion.STATUS))
    wait_until(lambda: (tmp_path / "lines").exists() and 'quality="bad"' in (tmp_path / "lines").read_text())


def test_what_waits_is_bounded_and_the_oldest_goes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "away"
    size = sum(len(everything().payload(topic)) for topic in everything().topics)
    monkeypatch.setattr(influxdb, "MOST_WAITING", 3 * size)
    monkeypatch.setattr(influxdb, "_FIRST_PAUSE", 0.05)
    sink = opened(file=folder / "lines")
    for step in range(20):
        sink.publish(everything(step))
    wait_until(lambda: "cannot be written" in caplog.text)
    for step in range(20, 30):
        sink.publish(everything(step))
    # What is being written meanwhile counts again once it has come back.
    wait_until(lambda: dropped(sink) >= 26 * len(everything().topics))
    folder.mkdir()
    newest = json.loads(everything(29).payload("forecast"))
    wait_until(lambda: (folder / "lines").exists())
    sink.close()
    times = [
        point.time for point in points((folder / "lines").read_text()) if point.measurement == "thermogate_forecast"
    ]
    assert times[-1] == seconds(newest, "valid_time")
    assert len(set(times)) <= 4
    assert caplog.text.count("[influxdb]") == 1


def test_a_database_has_what_was_announced_while_it_was_away(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    port = free_port()
    (tmp_path / "password").write_text("test-only\n")
    login = {"url": f"http://127.0.0.1:{port}", "user": "reader", "password_file": tmp_path / "password"}
    topics = len(everything().topics)
    sinks = [opened(database="house", **login)]
    try:
        for step in (1, 2):
            sinks[0].publish(everything(step))
        wait_until(lambda: "cannot be reached" in caplog.text)
        with influx.server(tmp_path, port) as table:
            wait_until(lambda: "[influxdb]: lines arrive" in caplog.text)
            asked = {"db": "house", "q": "SELECT mean, sd FROM thermogate_forecast_outputs", "epoch": "s"}
            (series,) = json.loads(influx.post(table, "/query", asked))["results"][0]["series"]
            told = [json.loads(everything(step).payload("forecast")) for step in (1, 2)]
            assert series["values"] == [[seconds(one, "valid_time"), one["mean"], one["sd"]] for one in told]
            tags = {"db": "house", "q": 'SHOW TAG VALUES FROM thermogate_status WITH KEY IN ("site", "zone")'}
            assert all(name in influx.post(table, "/query", tags) for name in ("htwg", "living"))
            assert caplog.text.count("what is announced waits") == 1

            sinks.append(opened(database="later", **login))
            sinks[1].publish(everything())
            wait_until(lambda: "database not found" in caplog.text)
            influx.post(table, "/query", {"q": "CREATE DATABASE later"})
            wait_until(lambda: caplog.text.count("[influxdb]: lines arrive") == 2)
            assert [dropped(sink) for sink in sinks] == [0, 0]

            # A field keeps the type with which it was first written.
            influx.post(table, "/query", {"q": "CREATE DATABASE other"})
            other = f"thermogate_forecast quality=1.0 {seconds(told[1], 'valid_time'):.0f}000000000"
            influx.post(table, "/write", {"db": "other"}, other.encode())
            sinks.append(opened(database="other", **login))
            for count in (1, 2):
                sinks[2].publish(everything())
                wait_until(lambda count=count: dropped(sinks[2]) == count * topics)
            assert caplog.text.count("what is refused is dropped") == 1
    finally:
        for sink in sinks:
            sink.close()
            sink.close()


def test_victoriametrics_has_the_numbers_of_what_was_announced(tmp_path: Path) -> None:
    port = free_port()
    sink, told = opened(url=f"http://127.0.0.1:{port}"), json.loads(everything().payload("forecast"))
    asked = f"http://127.0.0.1:{port}/api/v1/export?match[]=thermogate_forecast_outputs_mean"
    try:
        sink.publish(everything())
        with influx.victoria(tmp_path, port):
            series = json.loads(wait_until(lambda: (said := influx.answer(asked)) != "empty" and said))
    finally:
        sink.close()
    assert series["values"] == pytest.approx([told["mean"]])
    assert series["timestamps"] == [1000 * seconds(told, "valid_time")]
    assert {name: series["metric"][name] for name in ("site", "zone")} == {"site": "htwg", "zone": "living"}


def test_a_database_that_never_answers_holds_nobody_up() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        sink = opened(url=f"http://127.0.0.1:{silent.getsockname()[1]}")
        for step in range(50):
            sink.publish(everything(step))
        sink.settle()
        sink.close()
        assert dropped(sink) == 0
