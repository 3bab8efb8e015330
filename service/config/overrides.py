"""Changes to a configuration from the command line: `--set dotted.key=value`."""

import copy
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from adapters.fields.words import shown, suggestion
from service.errors import ConfigError


def apply_overrides(raw: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """A copy of `raw` with every "dotted.key=value" applied in order; ConfigError lists the ones that cannot be.

    The value is TOML if it parses as such, text otherwise. Items of a list are named by index or by their id
    ("zones.living.period=10min"); tables that are not there yet are made.
    """
    changed = copy.deepcopy(dict(raw))
    problems = []
    for override in overrides:
        try:
            _apply(changed, override)
        except ValueError as error:
            problems.append(f"--set {override}: {error}")
    if problems:
        raise ConfigError(problems)
    return changed


def _apply(raw: dict[str, Any], override: str) -> None:
    key, equals, value = override.partition("=")
    if not equals:
        raise ValueError('there is no "="; write it as key=value, such as http.port=8081')
    *parents, last = _parts(key.strip())
    table: Any = raw
    for depth, part in enumerate(parents):
        where = ".".join(parents[:depth]) or "the configuration"
        table = table.setdefault(part, {}) if isinstance(table, dict) else table[_index(table, part, where)]
    where = ".".join(parents) or "the configuration"
    if isinstance(table, dict):
        table[last] = _value(value.strip())
    else:
        table[_index(table, last, where)] = _value(value.strip())


def _parts(key: str) -> list[str]:
    try:
        table: Any = tomllib.loads(f"{key} = 0")
    except ValueError:
        table = None
    parts = []
    while isinstance(table, dict) and len(table) == 1:
        ((part, table),) = table.items()
        parts.append(part)
    if not parts or table != 0:
        raise ValueError(f"{shown(key)} is not a key; write names joined by dots, such as zones.living.period=10min")
    return parts


def _index(items: object, part: str, where: str) -> int:
    if not isinstance(items, list):
        raise ValueError(f"{where} is {shown(items)} and has no keys of its own, so {shown(part)} cannot be set in it")
    ids = [str(item["id"]) for item in items if isinstance(item, dict) and "id" in item]
    for index, item in enumerate(items):
        if isinstance(item, dict) and item.get("id") == part:
            return index
    if part.isdecimal() and int(part) < len(items):
        return int(part)
    if not items:
        raise ValueError(f"{where} is an empty list, so it has no item {shown(part)}")
    known = suggestion(part, ids, "its ids are") if ids else "use an index"
    raise ValueError(f"{where} has no item {shown(part)}; {known}, and its indices go from 0 to {len(items) - 1}")


def _value(text: str) -> Any:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except ValueError:
        return text
    except RecursionError:
        raise ValueError("the value is nested too deeply; no key takes more than a few levels") from None
    return parsed["value"] if parsed.keys() == {"value"} else text
