"""The reference tables of the documentation are made from the models of the configuration: `make golden` writes them.

A page has `<!-- table: module.Model -->` where the table of a model belongs. A key that a source and its channels both
have is told with the channels.
"""

import math
import os
import re
from collections.abc import Iterator
from importlib import import_module
from inspect import get_annotations
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import pytest
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined
from support.harness import ROOT
from support.schemas import models

from adapters.bacnet import config as bacnet
from adapters.channel import ChannelConfig, LiveConfig, SourceConfig
from adapters.fields import values
from adapters.fields.durations import format_duration, parse_duration
from adapters.fields.logins import CertificatesConfig, LoginConfig
from adapters.fields.sizes import format_size
from adapters.kinds import SOURCE_KINDS
from adapters.messages.config import MessageChannelConfig, pointer
from adapters.mqtt.broker import BrokerConfig
from adapters.series import config as series
from adapters.weather.config import WEATHER_KINDS
from adapters.zenoh.connection import SessionConfig
from service.config.network_tables import BoundsConfig, InlineConfig, PresetConfig
from service.config.site import Config, ZoneConfig
from service.publish.kinds import SINK_KINDS

MARK = re.compile(r"(<!-- table: ([\w.]+) -->\n)(?:\|.*\n)*")

SHARED = (
    ChannelConfig,
    MessageChannelConfig,
    BoundsConfig,
    LoginConfig,
    CertificatesConfig,
    BrokerConfig,
    SessionConfig,
    series.SeriesConfig,
)
"""Models whose keys other tables have as well: they stand in the table of the model that a page names for them."""

SHAPES = {
    values.bearable: "duration up to 1 min",
    values.journal_size: "size from 16MB",
    values.number: "number",
    values.positive: "number > 0",
    values.non_zero: "number, not 0",
    values.positive_duration: "duration > 0",
    parse_duration: "duration",
    values.flag: "true or false",
    values.level: "number in (0, 1)",
    values.path: "path",
    values.time_zone: "time zone",
    values.identifier: "id",
    values.name: "name",
    values.endpoint: "endpoint",
    values.pace: '`"max"` or number > 0',
    values.delimiter: "one character",
    bacnet.lifetime: "duration, 30 s to 1 d",
    pointer: "text",
    series.moment: "time",
}
"""What a check of a value asks for."""


def filled(path: Path) -> str:
    """The text of the page at `path` with every table as it is to be."""
    return MARK.sub(lambda mark: mark[1] + table(model_of(mark[2])), path.read_text(encoding="utf-8"))


def marked(path: Path) -> list[type[BaseModel]]:
    """The models whose tables the page at `path` has."""
    return [model_of(mark[2]) for mark in MARK.finditer(path.read_text(encoding="utf-8"))]


def model_of(dotted: str) -> type[BaseModel]:
    """The model called module.Model."""
    module, _, name = dotted.rpartition(".")
    model = getattr(import_module(module), name)
    assert issubclass(model, BaseModel)
    return model


def table(model: type[BaseModel]) -> str:
    """The table of `model` in Markdown."""
    rows = ["| key | default, or type | meaning |", "|---|---|---|", *_rows(model)]
    return "".join(f"{row}\n" for row in rows)


def _rows(model: type[BaseModel]) -> Iterator[str]:
    own = get_annotations(model)
    taken = [base for base in SHARED if issubclass(model, base) and model is not base]
    passed_on = []
    # What is the model's own comes first, whatever its bases have.
    for name, field in sorted(model.model_fields.items(), key=lambda item: (item[0] != "kind", item[0] not in own)):
        if name not in own and any(name in base.model_fields for base in taken):
            continue
        if issubclass(model, LiveConfig) and name in model.channel.model_fields:
            passed_on.append(f"`{name}`")
            continue
        yield f"| `{name}` | {_taken(model, name, field)} | {_told(field)} |"
    if passed_on:
        yield f"| {', '.join(passed_on)} | as of channels | for channels without the key |"


def _taken(model: type[BaseModel], name: str, field: FieldInfo) -> str:
    """The default of a key, with the others where there are few to choose from; without a default its type."""
    shape, default = _shape(field), _default(model, name, field)
    if default is None or default == "required":
        return shape if default is None else f"{shape}, required"
    others = [one for one in shape.split(", ") if one != default]
    return f"{default}, else {' or '.join(others)}" if default in shape.split(", ") else default


def _shape(field: FieldInfo) -> str:
    return _of(field.annotation, field.metadata)


def _of(annotation: Any, metadata: Any = ()) -> str:
    for one in metadata:
        check = getattr(one, "func", None)
        shape = SHAPES.get(check) or getattr(check, "shape", None)
        if shape:
            return str(shape)
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _of(inner[0], annotation.__metadata__)
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(_of(one) for one in inner if one is not type(None)))
    if origin is Literal:
        return " or ".join(f'`"{one}"`' for one in inner)
    if origin is tuple:
        item = _of(inner[0])
        plural = f"{item}s" if item.isalpha() else item
        return f"two {plural}" if len(inner) == 2 and inner[1] is not Ellipsis else f"list of {plural}"
    if origin is dict or (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
        return "table"
    return {str: "text", bool: "true or false", float: "number", int: "whole number"}.get(annotation, "table")


def _default(model: type[BaseModel], name: str, field: FieldInfo) -> str | None:
    """The default as TOML, None where nothing is one, or "required"."""
    value = field.default
    if name == "kind":
        return "required"
    if issubclass(model, ChannelConfig) and value is None:
        for source in _sources(model):
            # What a source has to name is its channels' to leave out.
            if name in source.model_fields and not source.model_fields[name].is_required():
                value = source.model_fields[name].default
    if value is PydanticUndefined:
        return None if "none:" in (field.description or "") else "required"
    if value is None:
        return None
    if isinstance(value, BaseModel):
        given = [f"{key} = {_toml(one, '')}" for key, one in value.model_dump(exclude_unset=True).items()]
        return f"`{{ {', '.join(given)} }}`" if given else "`{}`"
    return f"`{_toml(value, _shape(field))}`"


def _sources(model: type[BaseModel]) -> list[type[BaseModel]]:
    """The tables of the sources that have channels in a table of `model`."""
    found: list[type[SourceConfig]] = [SourceConfig]
    for one in found:
        found += one.__subclasses__()
    return [one for one in found if issubclass(getattr(one, "channel", ChannelConfig), model)]


def _toml(value: Any, shape: str) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if shape.startswith("duration"):
        return f'"{format_duration(value)}"'
    if shape.startswith("size"):
        return f'"{format_size(value)}"'
    if isinstance(value, float):
        return '"max"' if value == math.inf else f"{value:g}"
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml(item, '') for item in value)}]"
    if isinstance(value, int):
        return str(value)
    return "{}" if value == {} else f'"{value}"'


def _told(field: FieldInfo) -> str:
    text = re.sub(r"^(?:the|a|an) ", "", field.description or "kind of source")
    text = re.sub(r"(?<!`)(\[+\w+\.<?\w+>?\]+)", r"`\1`", text)
    head, such_as, example = text.partition(" such as ")
    if such_as and re.search(r"[\[{=]", example) and "`" not in example:
        return f"{head}{such_as}`{example}`"
    return text.replace("|", r"\|")


PAGES = [ROOT / "docs" / "configuration.md", *sorted((ROOT / "adapters").glob("*/README.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_tables_of_a_page_are_those_of_the_models(page: Path) -> None:
    written = filled(page)
    if os.environ.get("THERMOGATE_GOLDEN") == "write":
        page.write_text(written, encoding="utf-8")
    assert page.read_text(encoding="utf-8") == written


def test_no_table_of_the_configuration_is_left_out() -> None:
    shown = {model for page in PAGES for model in marked(page)}
    kinds = [*SOURCE_KINDS.values(), *(kind.channel for kind in SOURCE_KINDS.values()), *WEATHER_KINDS.values()]
    roots = [Config, PresetConfig, InlineConfig, *kinds, *(kind.table for kind in SINK_KINDS.values())]
    needed = models(*roots) - {Config, ZoneConfig}
    bases = {base for model in needed for base in SHARED if issubclass(model, base)}
    # A subclass that has no key of its own needs no table of its own.
    own = {model for model in needed | bases if get_annotations(model)}
    assert {model.__name__ for model in own - shown} <= {"SourceConfig", "WeatherConfig"}


def test_every_key_says_what_it_means() -> None:
    for page in PAGES:
        for model in marked(page):
            rows = table(model).splitlines()[2:]
            assert not [row for row in rows if row.endswith("| kind of source |") and not row.startswith("| `kind`")]
