"""The reference tables of the documentation are those of the models. `make golden` writes them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from inspect import get_annotations
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin

import pytest
from pydantic import BaseModel
from support import reference
from support.harness import ROOT

from adapters.kinds import SOURCE_KINDS
from adapters.weather.config import WEATHER_KINDS
from service.config.network_tables import InlineConfig, PresetConfig
from service.config.site import Config, ZoneConfig
from service.publish.kinds import SINK_KINDS

PAGES = [ROOT / "docs" / "configuration.md", *sorted((ROOT / "adapters").glob("*/README.md"))]


def models(annotation: Any, seen: set[Any]) -> Iterator[type[BaseModel]]:
    """The models in `annotation` and in their fields."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        if annotation not in seen:
            seen.add(annotation)
            yield annotation
            for field in annotation.model_fields.values():
                yield from models(field.annotation, seen)
    elif get_origin(annotation) in (Union, UnionType) or get_args(annotation):
        for part in get_args(annotation):
            yield from models(part, seen)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_tables_of_a_page_are_those_of_the_models(page: Path) -> None:
    written = reference.page(page)
    if os.environ.get("THERMOGATE_GOLDEN") == "write":
        page.write_text(written, encoding="utf-8")
    assert page.read_text(encoding="utf-8") == written


def test_no_table_of_the_configuration_is_left_out() -> None:
    shown = {model for page in PAGES for model in reference.marked(page)}
    kinds = [*SOURCE_KINDS.values(), *(kind.channel for kind in SOURCE_KINDS.values()), *WEATHER_KINDS.values()]
    roots = [Config, PresetConfig, InlineConfig, *kinds, *(kind.table for kind in SINK_KINDS.values())]
    seen: set[Any] = {ZoneConfig}
    needed = {model for root in roots for model in models(root, seen)} - {Config}
    bases = {base for model in needed for base in reference.SHARED if issubclass(model, base)}
    # A subclass that has no key of its own needs no table of its own.
    own = {model for model in needed | bases if get_annotations(model)}
    assert {model.__name__ for model in own - shown} <= {"SourceConfig", "WeatherConfig"}


def test_every_key_says_what_it_means() -> None:
    for page in PAGES:
        for model in reference.marked(page):
            rows = reference.table(model).splitlines()[2:]
            assert not [row for row in rows if row.endswith("| kind of source |") and not row.startswith("| `kind`")]
