"""A report of a replay and of a state folder: its figures are those of the payloads, and it needs no network."""

import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from support.daemon_state import leave_state
from support.tables import tabled

from estimator.diagnosis.finding import AT_BOUND, Diagnosis, Finding
from replay.errors import ReplayError
from replay.experiments.request import Request
from replay.experiments.topology import experiment as topology
from replay.experiments.topology.data import recordings
from replay.localtime import DAY, HOUR
from replay.recorded.runner import replay_recording
from replay.recorded.stored import stored_traces
from replay.reports.kit.table import shown
from replay.reports.language import in_language, sayer
from replay.reports.page import report
from replay.reports.publish import publish_report
from replay.reports.tables import parameters, percent
from service.cli.main import main
from service.config.load import load
from service.errors import ServiceError, StateMismatch
from service.forecast.answers import ToDo
from service.publish.payloads import NextHeatingPayload
from service.records.sample import Sample
from service.records.trust import HorizonTrust, Trust
from service.store.journal import Journal
from service.store.store import CHECKPOINTS, CONFIGURATION, JOURNAL, locked

EXAMPLE = Path(__file__).parents[3] / "deploy" / "examples" / "building-67.toml"
ZONE = "building-67"
SETTINGS = [f'zones.{ZONE}.estimator="mkf"', f"zones.{ZONE}.estimator_options={{particles=16}}"]


def config(state_dir, *settings):
    return load(EXAMPLE, [*SETTINGS, f'site.state_dir="{state_dir}"', *settings])


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    out = tmp_path_factory.mktemp("replayed")
    return out, replay_recording(config(out / "state"), out, progress=False)


@pytest.fixture
def trace(replayed):
    (one,) = replayed[1]
    return one


@pytest.fixture(scope="module")
def state(tmp_path_factory, replayed):
    """What a daemon would have left of the same recording, with a checkpoint at two thirds."""
    folder, (trace,) = tmp_path_factory.mktemp("state"), replayed[1]
    rows = zip(trace.rows, trace.inputs, strict=True)
    samples = (Sample.measured(row.time, np.array([row.y]), inputs) for row, inputs in rows)
    _, skill = leave_state(config(folder), samples, 2 * len(trace.rows) // 3)
    return folder, skill


class Page(HTMLParser):
    """Headings, plots and whatever a page would load."""

    def __init__(self, text):
        super().__init__()
        self.headings, self.charts, self.loads, self._in = [], [], [], None
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self._in = tag
        if given.get("class") == "chart":
            self.charts.append({"x": [float(end) for end in given["data-x"].split()], "paths": []})
        if tag == "path":
            self.charts[-1]["paths"].append((given["class"], given["d"]))
        self.loads += [value for name, value in given.items() if name in ("src", "href", "action")]
        self.loads += ["link"] * (tag in ("link", "iframe", "img"))

    def handle_endtag(self, tag):
        self._in = None

    def handle_data(self, data):
        if self._in in ("h2", "figcaption"):
            self.headings.append(data)


@tabled
def test_a_report_tells_how_far_its_forecasts_can_be_relied_on(trace, levels, beaten, told):
    horizons = [
        HorizonTrust(lead, level, "too narrow" if level == "doubtful" else "", 0)
        for lead, level in zip((3600, 21600), levels, strict=True)
    ]
    trust = Trust(0, tuple(horizons), beaten=beaten)
    made = report("site", [trace._replace(trust=trust, notes=("Learned anew.",))])
    (forecasts,) = (section for section in made.sections if section.title == "Forecasts")
    assert forecasts.paragraphs[0].endswith(told)
    assert made.sections[-1].paragraphs[0] == "Learned anew.", "where figures come from keeps nobody from them"


def test_a_report_tells_when_to_start_heating_in_the_words_of_the_page(trace):
    end = trace.rows[-1].time + trace.period
    heating = NextHeatingPayload(21.0, end + 25200.0, 0.9, end + 19800.0, 0.93)
    for start, words in ((heating.start, "start at {}, 1.5 h before: then"), (None, "even if heating starts at {},")):
        made = report("site", [trace._replace(heating=replace(heating, start=start))])
        (told,) = (text for text in made.sections[0].paragraphs if text.startswith("When to start heating: "))
        assert f"{words.format(trace.moment(int(start or end)))} it has 21.0 °C, or at most 0.5 K less" in told
        assert "21,0 °C oder höchstens 0,5 K weniger" in sayer("de")(told)


def test_a_report_tells_the_rooms_in_the_order_of_what_to_do(trace):
    rooms = {"calm": (), "urgent": (ToDo("shut the window", "it is open", 1.0),)}
    made = report("site", [trace._replace(zone=zone, room=replace(trace.room, to_do=do)) for zone, do in rooms.items()])
    told = [section.title.partition(":")[0] for section in made.sections if "how is this room" in section.title]
    assert told == ["urgent", "calm"]


def test_the_table_has_the_figures_of_the_summary(replayed, tmp_path, capsys):
    out, traces = replayed
    assert publish_report("semi-synthetic", traces, tmp_path / "new") == 0
    printed = capsys.readouterr().out
    summary = json.loads((out / "summary.json").read_text())["zones"][ZONE]["skill"]
    rows = [line.split() for line in printed.splitlines() if line.startswith(ZONE)]
    assert [" ".join(row[1:3]) for row in rows] == ["one step", "1 h", "6 h", "24 h"]
    for row, one in zip(rows, summary.values(), strict=True):
        against = [percent(one["skill_against_persistence"]), percent(one["skill_against_arx"])]
        figures = [shown(one[name]) for name in ("forecasts", "coverage", "width", "rmse")]
        assert row[3:] == [*figures, *" ".join(against).split()]
    assert str(tmp_path / "new" / "report.html") in printed
    page = (tmp_path / "new" / "report.html").read_text()
    for row in rows:
        assert all(f">{cell}<" in page for cell in row[3:7])


def test_the_page_is_whole_and_loads_nothing(replayed, tmp_path):
    publish_report("semi-synthetic", replayed[1], tmp_path)
    page = Page((tmp_path / "report.html").read_text())
    assert page.loads == []
    assert page.headings == [
        *("How is this room?", "What it is like", "Heat besides the heating, by the hour of the day"),
        *("Forecasts", "What the forecasts were worth"),
        "The record, and the band that was published before each measurement",
        "A day ahead: forecasts issued at midnight, and what came",
        *("Heat that no channel measures", "For experts: what to change in the configuration"),
        *("For experts: parameters", "Parameters at the end", "Parameters over time"),
        "For experts: residuals",
        *("Calibration (probability integral transform)", "Does an error predict the next?"),
        *("Do the errors follow an input?", "All zones", "Zones"),
    ]
    assert len(page.charts) == 8
    for chart in page.charts:
        assert all(drawn for _, drawn in chart["paths"])


def test_a_zone_without_physics_says_what_it_cannot_show(tmp_path):
    changed = [f'zones.{ZONE}.estimator="arx"', f"zones.{ZONE}.estimator_options={{}}"]
    traces = replay_recording(load(EXAMPLE, changed), tmp_path, end=1712730000.0, progress=False)
    publish_report("semi-synthetic", traces, tmp_path)
    text = (tmp_path / "report.html").read_text()
    assert "no model of unmeasured heat" in text
    assert "No parameters: the estimator has no physics" in text
    assert "No whole day between two midnights" in text


def strings(report):
    """Everything that a report says."""
    yield report.title
    yield from report.lead
    for section in report.sections:
        yield from (section.title, *section.paragraphs)
        for table in section.tables:
            yield from (table.title, table.note, *table.columns)
            yield from (shown(cell) for row in table.rows for cell in row if isinstance(cell, str | float))
        for one in section.plots:
            yield from (one.title, one.reading)
        for plot in section.plots:
            labels = (text for panel in plot.chart.panels for text in (panel.title, panel.unit) if text)
            yield from map(plot.chart.say, (*labels, *plot.chart.names, plot.chart.axis))


def test_a_report_in_german_leaves_no_sentence_in_english(trace, tmp_path, capsys):
    at_bound = (
        "C_i is at its lower bound of 1e5 J/K, so the true value may lie beyond it; move parameters.C_i.lower and "
        "start the zone anew"
    )
    findings = [Finding(AT_BOUND, "C_i", sentence) for sentence in (at_bound, "a sentence that nobody knows")]
    traces = [trace, trace._replace(zone="median", diagnosis=Diagnosis(tuple(findings)))]
    names = {ZONE, "median", "mkf", *trace.network.channels, *(p.name for p in trace.network.parameters)}
    english = list(strings(report("site", traces)))
    german = list(strings(in_language(report("site", traces), "de", names)))
    assert len(english) == len(german) > 100
    both = zip(english, german, strict=True)
    left = {one for one, other in both if one == other and re.search("[a-z]{2} [a-z]{2}", one)}
    assert left == {"`parameter-at-bound`: a sentence that nobody knows."}
    assert "median" in german, "a room may be called so"
    assert "Menschen und Geräte" in german
    assert any(text.startswith("`parameter-at-bound`: C_i liegt an der unteren Grenze von 1e5 J/K") for text in german)
    assert not any(re.search(r"\d\.\d", text) for text in german), "a German decimal is a comma"
    # But of a name, and of code.
    assert sayer("de", {"EG 1.02"})("EG 1.02 `sd = 0.5` 1.5e6") == "EG 1.02 `sd = 0.5` 1,5e6"
    publish_report("site", traces, tmp_path, language="de")
    assert "<html lang='de'>" in (tmp_path / "report.html").read_text()
    assert "Was die Vorhersagen wert waren" in capsys.readouterr().out


def test_a_report_leads_with_the_room_that_needs_most(trace):
    fine = trace._replace(zone="fine", room=replace(trace.room, to_do=()))
    made = report("site", [fine, trace])
    assert [sentence.split("`")[1] for sentence in made.lead] == [ZONE, "fine"]
    (table,) = made.sections[1].tables
    assert [row[1] for row in table.rows] == [f"{one.sentence}." for one in fine.room.answers[1:]]


def test_every_time_is_that_of_the_site(trace, tmp_path):
    drawn = []
    for name in (None, "Asia/Tokyo"):
        publish_report("site", [trace._replace(time_zone=name)], tmp_path)
        page = (tmp_path / "report.html").read_text()
        drawn.append(np.array(Page(page).charts[1]["x"]))
    assert (drawn[1] - drawn[0] == 9 * HOUR).all()
    assert "Times are those of Asia/Tokyo" in page
    assert trace._replace(time_zone="Asia/Tokyo").moment(trace.rows[0].time) in page
    assert trace.moment(trace.rows[0].time) not in page


def test_a_set_point_is_drawn_and_changes_no_forecast(tmp_path):
    settings = [f'zones.{ZONE}.estimator="arx"', f"zones.{ZONE}.estimator_options={{}}"]
    meant = 'setpoint={source="simulation",column="T_i",unit="degC"}'
    (without,) = replay_recording(load(EXAMPLE, settings), tmp_path / "without", end=1712730000.0, progress=False)
    traces = replay_recording(
        load(EXAMPLE, [*settings, f"zones.{ZONE}.{meant}"]), tmp_path, end=1712730000.0, progress=False
    )
    assert repr([replace(row, setpoint=float("nan")) for row in traces[0].rows]) == repr(without.rows)
    assert np.isfinite([row.setpoint for row in traces[0].rows]).all()
    publish_report("site", traces, tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "set-point</li>" in page
    assert "line blue dashed" in [kind for kind, _ in Page(page).charts[0]["paths"]]
    header, first = (tmp_path / ZONE / "updates.csv").read_text().splitlines()[:2]
    assert float(first.split(",")[header.split(",").index("setpoint")]) == traces[0].rows[0].setpoint


def test_the_page_of_an_earlier_replay_does_not_stand_for_one_that_fails(tmp_path, capsys):
    (tmp_path / "report.html").write_text("of yesterday")
    assert main(["replay", str(EXAMPLE), "--out", str(tmp_path), "--start", "2030-01-01T00:00:00Z"]) == 1
    assert "no usable sample" in capsys.readouterr().err
    assert not (tmp_path / "report.html").exists()


def test_the_fans_are_whole_days_and_begin_with_what_was_published(trace):
    assert [fan.times[0] % DAY for fan in trace.fans] == [0] * 2
    rows = {row.time: row for row in trace.rows}
    for fan in trace.fans:
        assert len(fan.times) == DAY // trace.period
        first = rows[int(fan.times[0])]
        lower, median, upper = fan.quantiles[0]
        # Thirty-two draws stand for the state: their median is known to a quarter of the spread.
        assert abs(median - first.mean) < first.sd
        assert lower < median < upper
        widths = fan.quantiles[:, 2] - fan.quantiles[:, 0]
        assert widths[-1] > widths[0]


def test_the_parameters_are_looked_at_every_six_hours_and_stay_in_their_bounds(trace):
    assert np.diff(trace.looks).tolist() == [DAY // 4] * 11
    for place, parameter in enumerate(trace.network.parameters):
        values = trace.parameters[:, place]
        assert (np.diff(values) >= 0).all()
        assert (parameter.lower * (1 - 1e-9) <= values).all()
        assert (values <= parameter.upper * (1 + 1e-9)).all()
    assert trace.gain.shape == (len(trace.rows), 3)
    assert np.isfinite(trace.gain[1:]).all()
    table = parameters(trace._replace(parameters=trace.parameters * [np.nan, 1.0, np.nan]))
    assert all(row[2] is row[4] is None and row[-1] == "collapsed" for row in table.rows[:-1])


def contents(folder):
    return {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.rglob("*.*") if path.is_file()}


def test_the_history_of_a_daemon_gives_the_same_and_is_left_alone(replayed, state):
    (whole,), (folder, skill) = replayed[1], state
    zones, before = load(folder / CONFIGURATION).zones, contents(folder)
    with locked(folder):  # as a running daemon holds it
        (trace,) = stored_traces(folder, zones, None, progress=False)
    assert {path.name for path in contents(folder)} - {path.name for path in before} <= {
        f"{JOURNAL}-wal",
        f"{JOURNAL}-shm",
    }
    assert {path: contents(folder)[path] for path in before} == before
    assert repr(trace.rows) == repr(whole.rows)
    np.testing.assert_array_equal(trace.parameters, whole.parameters)
    assert repr(trace.skill) == repr(skill), "the daemon's own word, as of its newest checkpoint"
    assert "bit for bit" in trace.notes[0]


def test_a_shorter_period_keeps_the_published_forecasts_and_says_what_is_new(replayed, state):
    (whole,), (folder, _) = replayed[1], state
    (trace,) = stored_traces(folder, load(folder / CONFIGURATION).zones, 1, progress=False)
    assert repr(trace.rows) == repr(whole.rows[-144:])
    assert "were learned anew from the samples since 2024-04-12 00:00 (UTC), and" in trace.notes[0]
    assert "; skill, findings, thermostat and the answers about the room are those of its" in trace.notes[0]
    (known,) = stored_traces(folder, load(folder / CONFIGURATION).zones, None, progress=False)
    day, all_days = ({one.about: one for one in each.room.answers} for each in (trace, known))
    assert day["heat_loss"] == all_days["heat_loss"], "what the daemon knows, not what a day teaches"


def test_topology_takes_the_samples_of_a_daemon(replayed, state):
    (whole,), (folder, _) = replayed[1], state
    (found,) = recordings(Request(state=folder))
    assert found.record.times.tolist() == [row.time for row in whole.rows]
    np.testing.assert_array_equal(found.record.columns["T_i"], [row.y for row in whole.rows])
    np.testing.assert_array_equal(found.record.matrix(whole.network.inputs), whole.inputs)
    assert found.candidates[0].name == "own"


def test_the_network_that_is_found_on_live_history_is_printed(state, tmp_path, monkeypatch, capsys):
    def few(request):
        return [one._replace(candidates=one.candidates[:1]) for one in recordings(request)]

    monkeypatch.setattr(topology, "STARTS", 1)
    monkeypatch.setattr(topology, "recordings", few)
    folder, _ = state
    assert main(["experiment", "topology", "--jobs", "1", "--out", str(tmp_path), "--state", str(folder)]) == 0
    assert f'In zone "{ZONE}" of the daemon\'s configuration: below its channels' in capsys.readouterr().out
    assert f"as the daemon on <code>{folder}</code> has accepted its samples" in (tmp_path / "report.html").read_text()
    assert main(["experiment", "lies", "--out", str(tmp_path / "lies"), "--state", str(folder)]) == 1
    assert "--state means nothing to this experiment" in capsys.readouterr().err


def test_a_folder_without_state_and_one_of_another_configuration_are_said(state, tmp_path):
    folder, _ = state
    with pytest.raises(ServiceError, match=r"there is no configuration\.toml in .*; name the configuration with"):
        recordings(Request(state=tmp_path))
    zones = load(folder / CONFIGURATION).zones
    with pytest.raises(ServiceError, match=r"there is no state in .*; name the folder that site\.state_dir names"):
        stored_traces(tmp_path, zones, None, progress=False)
    other = load(EXAMPLE, [f'zones.{ZONE}.estimator="ekf"', f"zones.{ZONE}.estimator_options={{}}"]).zones
    with pytest.raises(StateMismatch, match="belongs to another network or other estimator options"):
        stored_traces(folder, other, None, progress=False)
    Journal.open(tmp_path / JOURNAL).close()
    with pytest.raises(ReplayError, match="there is no usable sample"):
        stored_traces(tmp_path, zones, None, progress=False)


def test_a_damaged_checkpoint_is_passed_over_and_stays(state, tmp_path):
    folder, _ = state
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    (damaged,) = (tmp_path / CHECKPOINTS / ZONE).iterdir()
    damaged.write_bytes(b"not a checkpoint")
    (trace,) = stored_traces(tmp_path, load(folder / CONFIGURATION).zones, None, progress=False)
    assert trace.skill is not None
    assert damaged.read_bytes() == b"not a checkpoint"


def test_a_page_of_hostile_names_keeps_them_text(replayed, tmp_path):
    hostile = "</script><script>alert(1)</script>"
    traces = [trace._replace(zone=hostile) for trace in replayed[1]]
    publish_report(hostile, [*traces, *traces], tmp_path)
    text = (tmp_path / "report.html").read_text()
    assert hostile not in text
    assert len(re.findall(r"<script>", text)) == 1, "what reads the charts"
