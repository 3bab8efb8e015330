"""The documentation says what the code does: examples run, tables name what there is, links lead somewhere."""

import gzip
import inspect
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from support import schemas
from support.all_metrics import exposed
from support.harness import EXAMPLES, ROOT, Daemon, python
from support.pages import TEXT, section, tables
from support.waiting import wait_until
from support.zenoh_plant import endpoint

import thermogate
from adapters.csv import config as csv
from adapters.reading import Fault, Quality
from adapters.units import conversion, default_valid_range
from adapters.weather import config as weather_models
from adapters.zenoh import config as zenoh_models
from estimator import registry
from estimator.bank import options as bank_options
from estimator.blackbox import options as arx_options
from estimator.gaussian import options as augmented_options
from estimator.mixture import options as mkf_options
from estimator.network import presets
from estimator.particle import options
from estimator.types import Outcome
from service.cli.main import main
from service.config import network_tables, site
from service.config.load import load
from service.config.networks import resolve
from service.daemon.reload import RELOADABLE
from service.publish import payloads, zenoh
from service.publish.sinks import TOPICS
from service.records import history, receipt, skill, trust
from service.records.record import document_of
from service.records.record import names as record_names
from service.records.status import STATES
from service.store import backup, checkpoint
from service.store.journal_file import SCHEMA_VERSION
from service.web import models as api_models
from service.web import planned
from service.web import problems as api_problems
from service.web.control import models as control_models
from service.web.page import payloads as page_models
from service.zone.aggregation import AGGREGATES, default_aggregate
from service.zone.worker import STARTED

PAGES = sorted(path for folder in (".", "docs/**", "deploy/**", "adapters/*") for path in ROOT.glob(f"{folder}/*.md"))


class Block(NamedTuple):
    """A fenced block: its language, the HTML comment before it, its text, and the block after it."""

    name: str
    language: str
    mark: str
    text: str
    after: str


def blocks(language: str) -> list[Any]:
    found = []
    for name, text in TEXT.items():
        matches = list(re.finditer(r"(?:<!-- ((?:(?!-->).)*) -->\n)?```(\w+)\n(.*?)```", text, re.DOTALL))
        for index, match in enumerate(matches):
            if match[2] == language:
                after = matches[index + 1][3] if index + 1 < len(matches) else ""
                place = f"{name}:{text.count(chr(10), 0, match.start()) + 1}"
                found.append(pytest.param(Block(place, language, match[1] or "", match[3], after), id=place))
    assert found
    return found


def names(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


def first_names(table: list[list[str]]) -> list[str]:
    return [name for row in table[1:] for name in names(row[0])]


def with_recordings(text: str, folder: Path) -> Path:
    """The configuration `text` as a file in `folder`, with a recording of the right columns for every file it names."""
    raw = tomllib.loads(text)
    for name, source in raw["sources"].items():
        if source["kind"] != "csv":
            continue
        channels = [channel for zone in raw["zones"] for channel in zone["channels"].values()]
        columns = [source["timestamp"]["column"]]
        for channel in channels:
            if channel["source"] == name:
                columns += channel.get("columns", [channel.get("column")])
        header = source.get("delimiter", ",").join(dict.fromkeys(columns)) + "\n"
        for file in source["files"]:
            opener = gzip.open if file.endswith(".gz") else open
            with opener(folder / file, "wt", encoding="utf-8") as stream:
                stream.write(header)
    path = folder / "docs.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("block", blocks("toml"))
def test_toml_examples_are_right(block: Block, tmp_path: Path) -> None:
    raw = tomllib.loads(block.text)
    if "site" in raw:
        config = load(with_recordings(block.text, tmp_path))
        assert config.site.id == raw["site"]["id"]
        assert config.warnings == ()
    elif raw.keys() == {"weather"}:
        for table in raw["weather"].values():
            weather_models.WEATHER_KINDS[table["kind"]].model_validate(table, context={"folder": tmp_path})
    elif raw.keys() == {"zenoh", "sources"}:
        context = {"folder": tmp_path}
        assert zenoh.ZenohConfig.model_validate(raw["zenoh"], context=context).mode == "client"
        for source in raw["sources"].values():
            zenoh_models.ZenohSourceConfig.model_validate(source, context=context)
    elif raw["zones"].keys() == {"setpoint"}:
        channel = csv.CsvChannelConfig.model_validate(raw["zones"]["setpoint"], context={"folder": tmp_path})
        assert (channel.address, channel.max_age) == ("Setpoint", 86400.0)
    elif raw["zones"].keys() == {"estimator_options"}:
        given = raw["zones"]["estimator_options"]
        options = registry.resolve(block.mark.removeprefix("estimator: "), presets.network("titeth"), 300, given)
        assert list(options.members) == list(given["members"])
    else:
        assert raw.keys() == {"zones"}, "a fragment shows one network, the options of a bank, or Zenoh sessions"
        assert raw["zones"].keys() == {"network"}
        model, table = network_tables.network_model(raw["zones"]["network"])
        network, wrong = resolve(model.model_validate(table))
        assert network is not None
        assert not wrong


def test_units_and_their_defaults_are_those_in_force() -> None:
    units, rules = tables(section("configuration.md", "`[zones.channels]`"))[1:]
    for unit, convertible, valid, rule in units[1:-1]:
        assert all(conversion(other, unit, nominal=1.0) for other in names(convertible) if other != "nominal")
        believable = default_valid_range(unit)
        assert [float(number) for number in re.findall(r"-?\d+(?:e\d+)?", valid)] in ([*believable], [])
        assert (valid == "none") == (believable[1] == float("inf"))
        assert names(rule)[:1] == [default_aggregate(unit)]
        assert names(rule)[1:] in ([], [default_aggregate(unit, "kWh")])
    assert first_names(rules) == list(AGGREGATES)


TITETH = presets.network("titeth")
RBPF, UKF = options.resolve, augmented_options.resolve_ukf
ARX, DAILY = arx_options.resolve, arx_options.resolve_daily


def paper(resolve: Any, preset: str = "building-67", period: int = 600) -> Any:
    """The options of the paper's preset for a network."""
    return resolve(presets.network(preset), period, {"preset": "paper"})


OPTIONS = [
    ("`[zones.estimator_options]`", options.Options, [RBPF(TITETH, 600, {}), paper(RBPF)]),
    ("Options of `ekf` and `ukf`", augmented_options.UKFOptions, [UKF(TITETH, 600, {}), paper(UKF)]),
    ("Options of `arx` and `daily`", arx_options.ARXOptions, [ARX(TITETH, 300, {}), DAILY(TITETH, 300, {})]),
    ("Options of `direct`", arx_options.DirectOptions, [arx_options.DirectOptions()]),
    ("Options of `bank`", bank_options.BankOptions, [bank_options.BankOptions()]),
]


def test_the_options_of_every_estimator_are_documented() -> None:
    headings = [heading for heading, *_ in OPTIONS[1:]] + ["Options of `mkf`"]
    assert {name for heading in headings for name in names(heading)} == {*registry.ESTIMATORS} - {"rbpf"}
    written = site.ZoneTable.model_fields["estimator"].description or ""
    assert {name.strip('"') for name in names(written)} == {*registry.ESTIMATORS}


@pytest.mark.parametrize(("heading", "kind", "shown"), OPTIONS, ids=lambda value: str(value)[:30])
def test_every_option_is_documented_with_its_values(heading: str, kind: Any, shown: list[Any]) -> None:
    text = section("configuration.md", heading)
    (table,) = tables(text)
    assert {*first_names(table)} == {field.name for field in fields(kind)} - {"preset", "volatility_blocks"}
    assert_values_as_documented([row for row in table if row[0] not in ("`members`", "`voice`")], shown)
    for of_paper in (RBPF, UKF):
        if isinstance(shown[-1], type(paper(of_paper))):
            # The text above the table says what the paper's preset changes for an Ecolar network.
            assert changes(text.partition("|")[0]) == differences(paper(of_paper, "ecolar-6r4c", 300), shown[-1])
    if kind is options.Options:
        assert {"preset", "discount", "volatility_blocks"} <= {*names(text)}


def test_every_option_of_mkf_is_documented_with_its_values() -> None:
    text = section("configuration.md", "Options of `mkf`")
    described, table = tables(text)
    shared = {*names(text.partition("with its default values: ")[2])} - {'volatility = "process"'}
    known = {field.name for field in fields(mkf_options.MKFOptions)}
    assert {*first_names(table)} | shared == known - {"preset"}
    assert {name for row in described[1:] for name in names(row[0])} == set(mkf_options.PRESETS)
    default = mkf_options.resolve(TITETH, 600, {})
    assert_values_as_documented(table, [default])
    rbpf = options.resolve(TITETH, 600, {})
    for name in shared:
        assert getattr(default, name) == getattr(rbpf, name), name


def test_what_a_reload_can_change_is_documented() -> None:
    rows: dict[str, str] = dict(tables(section("operations.md", "Reload"))[0][1:])
    described = {
        re.sub(r"\W.*", "", name[1:]): effect for row, effect in rows.items() for name in names(row) if "[" in name
    }
    assert described.keys() | {"zones", "sources"} == {*site.TABLES}
    after_a_restart = {name for name, effect in described.items() if "restart the daemon" in effect}
    assert after_a_restart == {*site.TABLES} - {*RELOADABLE}


def test_the_changelog_tells_the_versions_of_stored_state() -> None:
    told = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## ")[1].partition("### Stored state")[2]
    assert f"Journal schema {SCHEMA_VERSION}," in told
    assert f"checkpoint format {checkpoint.FORMAT_VERSION}" in told
    assert f"backup format {backup.FORMAT_VERSION}" in told


def assert_values_as_documented(table: list[list[str]], shown: list[Any]) -> None:
    """Each row of `table` has, before its meaning, the value of its option in each of the options `shown`."""
    for name, *cells, _ in table[1:]:
        for cell, resolved in zip(cells, shown, strict=True):
            value = getattr(resolved, names(name)[0])
            if isinstance(value, bool | str):
                assert cell == str(value).lower(), name
            else:
                assert float(cell) == pytest.approx(value, rel=1e-4), name


def changes(text: str) -> dict[str, Any]:
    """The options that `text` sets, such as `particles = 8`."""
    return tomllib.loads("\n".join(name for name in names(text) if " = " in name))


def differences(resolved: Any, default: Any) -> dict[str, Any]:
    """The options in which `resolved` differs from `default`, but for the name of its preset."""
    fresh = {field.name: getattr(resolved, field.name) for field in fields(resolved) if field.name != "preset"}
    return {
        name: value if isinstance(value, str | bool) else pytest.approx(value, rel=1e-4)
        for name, value in fresh.items()
        if value != getattr(default, name)
    }


RECORDS = (receipt, history, skill, trust)
PAYLOADS = (*RECORDS, payloads, api_models, page_models, api_problems, control_models, planned)
"""Where the models and records of the JSON examples are."""


def model_of(mark: str) -> tuple[type, bool]:
    """The model or record that a JSON example illustrates, and whether only what it adds to its base is shown."""
    match = re.fullmatch(r"model: (\w+)(, added fields)?", mark)
    assert match, f"a JSON example needs a comment <!-- model: Name -->, not {mark!r}"
    for module in PAYLOADS:
        if hasattr(module, match[1]):
            return getattr(module, match[1]), match[2] is not None
    raise AssertionError(f"there is no payload {match[1]}")


@pytest.mark.parametrize("block", blocks("json"))
def test_json_examples_have_the_fields_of_their_payloads(block: Block) -> None:
    model, added = model_of(block.mark)
    example = json.loads(block.text)
    if added:
        assert example.keys() == set(record_names(model)) - set(record_names(payloads.ForecastPayload))
        for step in example["fan"]:
            schemas.check(step, payloads.FanStepPayload)
    elif model in (planned.ForecastRequest, control_models.SiteForecastRequest):
        model.model_validate(example)
        assert example.keys() == model.model_fields.keys()
    elif model is api_problems.Problem:
        assert json.loads(model.model_validate(example).model_dump_json(exclude_none=True)) == example
    else:
        schemas.check(
            example, document_of(model, "zone" in example) if is_dataclass(model) and "schema" in example else model
        )


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Daemon, str]]:
    """The FlexHouse example and its Zenoh endpoint, running at a pace that outlasts the examples."""
    folder = tmp_path_factory.mktemp("daemon")
    place = endpoint()
    settings = {
        "site.state_dir": str(folder / "state"),
        "zones.0.estimator_options.particles": 200,
        "sources.recording.pace": 150,
        "zenoh.enabled": True,
        "zenoh.listen": [place],
    }
    with Daemon(EXAMPLES / "flexhouse.toml", folder / "log", settings) as running:
        running.wait(lambda zones: zones["office"]["samples"] >= 2)
        yield running, place


def in_python_page(block: Any) -> bool:
    return str(block.id).startswith("python.md:")


def needs_a_daemon(block: Any) -> bool:
    """tests/replay/energyplus/test_docs.py runs those of energyplus.md."""
    return not in_python_page(block) and not str(block.id).startswith("energyplus.md:")


@pytest.mark.parametrize("block", [block for block in blocks("python") if needs_a_daemon(block)])
def test_python_examples_run(block: Block, daemon: tuple[Daemon, str]) -> None:
    running, place = daemon
    running.wait(lambda zones: zones["office"]["state"] == "running")
    code = block.text.replace("http://127.0.0.1:8080", running.url()).replace("tcp/127.0.0.1:7447", place)

    def enough() -> str:
        printed = python(code)
        return printed if len(printed.splitlines()) >= 3 else ""

    # The one on Zenoh listens for 2 s, in which a machine that has much else to do may bring no forecast.
    printed = wait_until(enough)
    assert re.search(r"2021-02-\d\dT\d\d:\d\d:00Z", printed)


def test_the_python_page_runs_from_top_to_bottom(tmp_path: Path) -> None:
    """As a notebook would: one block after the other. Numbers in what is printed may differ between processors.

    `fit` warns that the table of the page is short.
    """
    (tmp_path / "deploy").symlink_to(ROOT / "deploy")
    page = [block.values[0] for block in blocks("python") if in_python_page(block)]
    ends = '\nprint("<<end>>")\n'
    done = subprocess.run(
        [sys.executable, "-W", "error", "-W", "ignore:the table", "-c", "".join(block.text + ends for block in page)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr
    assert "Error" not in done.stderr
    printed = done.stdout.split("<<end>>\n")
    shown = {block.text: block.after for block in page if block.after.startswith("Thermogate model")}
    assert shown
    for block, text in zip(page, printed, strict=False):
        if block.text in shown:
            printed_as, shown_as = (
                re.sub(r"[\d.]+|\((low|transitional|high)\)", "#", each) for each in (text, shown[block.text])
            )
            assert printed_as == shown_as
    assert 'no column "Raum" for T_i [degC]; its columns are Raumtemperatur' in printed[-2]


def test_the_python_page_lists_the_whole_interface() -> None:
    assert inspect.signature(thermogate.fit).parameters.keys() <= {*re.findall(r"\w+", thermogate.fit.__doc__ or "")}
    told = {name for name in vars(thermogate.Model) if not name.startswith("_")}
    listed = "\n".join(re.findall(r"^- .*", section("python.md", "The model"), re.MULTILINE))
    assert {name.partition("(")[0] for name in names(listed)} <= told
    assert all(inspect.getdoc(getattr(thermogate.Model, name)) for name in told)


def test_the_metrics_that_the_page_names_are_exposed() -> None:
    told = {name for name in names(section("operations.md", "Metrics")) if name.startswith("thermogate_")}
    assert told
    assert told <= exposed().keys()
    for name, kind in exposed().items():
        assert (kind == "counter") == name.endswith("_total"), name


def test_every_topic_is_documented() -> None:
    described = {names(row[0])[0] for row in tables(section("interfaces.md", "Zenoh"))[0][1:]}
    assert {f"thermogate/<site>/<zone>/{topic}" for topic in TOPICS} <= described
    assert {*TOPICS} <= {*names(section("mqtt.md", "Forecasts"))}


def offered(command: str, capsys: pytest.CaptureFixture[str]) -> set[str]:
    """The options of a command, as its help lists them."""
    assert main([command, "--help"]) == 0
    return set(re.findall(r"^  (?:-h, )?(--[a-z-]+)", capsys.readouterr().out, re.MULTILINE))


def test_every_command_takes_the_options_of_all(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    pages = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    for command in re.findall(r"^    ([a-z-]+)(?: |$)", capsys.readouterr().out, re.MULTILINE):
        assert {"--set", "--debug", "--help"} <= offered(command, capsys), command
        assert f"thermogate {command}" in pages


@pytest.mark.parametrize("block", blocks("sh"))
def test_shell_examples_use_options_that_exist(block: Block, capsys: pytest.CaptureFixture[str]) -> None:
    for line in block.text.splitlines():
        program, command, *words = line.split()
        assert program == "thermogate"
        assert {word for word in words if word.startswith("--")} <= offered(command, capsys)
        for path in (word for word in words if word.startswith("deploy/")):
            assert (ROOT / path).exists(), path


def test_lists_of_words_are_complete() -> None:
    assert first_names(tables(section("telemetry.md", "Faults"))[0]) == [str(fault) for fault in Fault]
    assert tuple(first_names(tables(section("telemetry.md", "States of a zone"))[0])) == STATES
    assert first_names(tables(section("interfaces.md", "Quality"))[0]) == [str(quality) for quality in Quality]
    outcomes = first_names(tables(section("interfaces.md", "Payload fields"))[0])
    assert {*outcomes} == {STARTED, "null", *map(str, Outcome)}


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_and_file_names_lead_somewhere(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)]+)\)", re.sub(r"```.*?```", "", text, flags=re.DOTALL)):
        if target.startswith("https://"):
            continue
        file, _, anchor = target.partition("#")
        there = (path.parent / file).resolve() if file else path
        assert there.exists(), target
        if anchor:
            headings = re.findall(r"^#+ (.*)", there.read_text(encoding="utf-8"), re.MULTILINE)
            anchors = [re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings]
            assert anchor in anchors, target
    for name in re.findall(r"`((?:estimator|adapters|service|replay|tests)/[\w/]+\.py)`", text):
        assert (ROOT / name).exists(), name
    for name in re.findall(r"python -m\s+(replay[\w.]*)", text):
        assert find_spec(name) is not None, name


def test_the_functions_that_the_architecture_names_are_in_their_files() -> None:
    mentions = re.findall(r"((?:`\w+`(?:, )?)+) in `([\w/]+\.py)`", TEXT["architecture.md"])
    assert len(mentions) > 5
    for functions, file in mentions:
        source = (ROOT / file).read_text(encoding="utf-8")
        for name in names(functions):
            assert re.search(rf"(?:def|class) {name}\b|^{name}\b", source, re.MULTILINE), f"{file} has no {name}"


def test_the_files_of_a_replay_are_documented(tmp_path: Path) -> None:
    settings = ["--set", "zones.room-1.estimator_options.particles=50"]
    assert main(["replay", str(EXAMPLES / "generic-csv.toml"), "--out", str(tmp_path), *settings]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    text = section("interfaces.md", "`summary.json`")
    assert {*first_names(tables(text)[0])} == summary["zones"]["room-1"].keys()
    assert {*names(text.split("Beside")[1])} == summary.keys()
    header = (tmp_path / "room-1" / "updates.csv").read_text(encoding="utf-8").splitlines()[0]
    assert first_names(tables(section("interfaces.md", "`updates.csv`"))[0]) == header.split(",")
