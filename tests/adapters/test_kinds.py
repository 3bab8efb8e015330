"""Every kind of source: its sample, what that amounts to, and its cases. A new kind brings them as data."""

import json
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import tomli_w
from support import cases
from support.processes import free_port
from support.recorder import database
from support.sources import bound, source_table

from adapters.errors import SourceUnavailable
from adapters.kinds import SOURCE_KINDS
from adapters.weather.config import WEATHER_KINDS
from service.config.load import load, load_sources
from service.config.written import effective_toml
from service.errors import ConfigError

ADAPTERS = Path(__file__).parents[2] / "adapters"
SAMPLES = sorted(ADAPTERS.glob("*/sample.toml"))


@pytest.fixture
def folder(request, tmp_path):
    """A copy of the folder of a kind without its code, with what its sample reads."""
    for path in request.param.iterdir():
        if path.is_file() and path.suffix != ".py":
            shutil.copy(path, tmp_path)
    if request.param.name == "home_assistant":
        entities = ("climate.living", "sensor.outdoor_temperature")
        database(tmp_path / "home-assistant_v2.db", [(0, entity, "20") for entity in entities])
    return tmp_path


def test_every_kind_has_a_sample():
    shown = [tomllib.loads(path.read_text(encoding="utf-8")) for path in SAMPLES]
    assert {one["kind"] for sample in shown for one in sample["sources"].values()} == set(SOURCE_KINDS)
    assert {one["kind"] for sample in shown for one in sample.get("weather", {}).values()} <= set(WEATHER_KINDS)


@pytest.mark.parametrize("folder", [path.parent for path in SAMPLES], indirect=True, ids=lambda path: path.name)
def test_a_sample_amounts_to_what_is_expected(folder, request):
    config = load(folder / "sample.toml")
    assert config == load(folder / "sample.toml"), "a reload would find changes where there are none"
    text = effective_toml(config)
    (folder / "again.toml").write_text(text, encoding="utf-8")
    assert effective_toml(load(folder / "again.toml")) == text, "what show-config prints is a configuration"
    shown = tomllib.loads(text.replace(str(folder.resolve()), "FOLDER"))
    amounts = {name: shown[name] for name in ("sources", "weather") if shown.get(name)}
    amounts["channels"] = shown["zones"][0]["channels"]
    amounts["reads"] = {name: table.described for name, table in config.sources.items()}
    amounts["edges"] = {one.id: repr(one.edge()) for name in config.sources for one in config.bindings(name)}
    amounts["addresses"] = {name: channel.address for name, channel in config.zones[0].channels.items()}
    expected = ADAPTERS / request.node.callspec.id / "testcases" / "expected.toml"
    if cases.WRITING:
        expected.write_text(tomli_w.dumps(amounts), encoding="utf-8")
    assert tomllib.loads(expected.read_text(encoding="utf-8")) == amounts


@pytest.mark.parametrize(("file", "name", "case"), cases.mistakes(*sorted(ADAPTERS.glob("*/testcases/mistakes.toml"))))
def test_a_mistake_is_one_sentence_with_its_place(file, name, case, tmp_path):
    shutil.copy(file.parents[1] / "sample.toml", tmp_path)
    cases.check_mistake(tmp_path / "sample.toml", file, name, case)


def test_a_wrong_kind_lists_the_right_ones(tmp_path):
    shutil.copy(ADAPTERS / "modbus" / "sample.toml", tmp_path)
    (problem,) = cases.problems(tmp_path / "sample.toml", ["sources.bms.kind=modbuss"])
    assert problem.endswith(f'the kinds are {", ".join(SOURCE_KINDS)}; did you mean "modbus"?')


def test_sources_can_be_read_without_zones(tmp_path):
    path = tmp_path / "scan.toml"
    path.write_text('[sources.bms]\nkind = "bacnet"\ninterface = "192.168.1.10/24"\n', encoding="utf-8")
    assert [*load_sources(path)] == ["bms"]
    path.write_text('[sources.bms]\nkind = "bacnet"\n', encoding="utf-8")
    with pytest.raises(ConfigError, match=r"sources\.bms\.interface: is missing"):
        load_sources(path)


def test_the_library_of_bacnet_is_imported_by_who_uses_it_only():
    code = "import sys, adapters.kinds, replay.bms.serving; sys.exit('bacpypes3' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=180).returncode == 0


TABLES = Path(__file__).with_name("nobody.json").read_text(encoding="utf-8").replace('"GONE"', "GONE")
NOBODY = json.loads(TABLES.replace("GONE", str(free_port())))
"""Of each kind that needs somebody or something: a table that leads to nobody, a channel, and the remedy."""


@pytest.mark.parametrize("kind", NOBODY)
async def test_where_nobody_is_a_source_says_so_in_one_sentence_again_and_again(kind):
    keys, channel, remedy = NOBODY[kind]
    quick = {"timeout": 0.3, "retries": 0}
    own = SOURCE_KINDS[kind].model_fields
    table = source_table(kind, **keys, **{key: value for key, value in quick.items() if key in own})
    bms = table.build("bms", [bound(table, "z/T", **channel)])
    for _ in range(2):
        with pytest.raises(SourceUnavailable, match=rf"^sources\.bms: [^\n]*{remedy}[^\n]*$"):
            await anext(bms.batches(None))
    await bms.close()
    await bms.close()
