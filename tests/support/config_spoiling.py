"""Ways to spoil the sound configuration of `config_samples`, and the mistakes that are then reported."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.config_samples import inline_network, sound, write

from service.config.load import load
from service.errors import ConfigError

Tables = dict[str, Any]
Change = Callable[[Tables], object]


def problems_of(folder: Path, change: Change) -> list[str]:
    tables = sound(folder)
    change(tables)
    with pytest.raises(ConfigError) as caught:
        load(write(folder, tables))
    return caught.value.problems


def at(*keys: str | int, **values: object) -> Change:
    """Set keys of the table found by following `keys`; None removes a key."""

    def change(tables: Tables) -> None:
        table: Any = tables
        for key in keys:
            table = table[key]
        for name, value in values.items():
            table.pop(name, None)
            if value is not None:
                table[name] = value

    return change


def living(**values: object) -> Change:
    return at("zones", 0, **values)


def air(**values: object) -> Change:
    return at("zones", 0, "channels", "T_i", **values)


def log(**values: object) -> Change:
    return at("sources", "log", **values)


def inline(*keys: str | int, **values: object) -> Change:
    def change(tables: Tables) -> None:
        tables["zones"][0]["network"] = inline_network()
        channels = tables["zones"][0]["channels"]
        channels["T_air"] = channels.pop("T_i")
        channels["I_sol"] = {"source": "log", "column": "Sun", "unit": "W/m2"}
        channels["n_people"] = {"source": "log", "column": "Sun", "unit": "people"}
        at("zones", 0, "network", *keys, **values)(tables)

    return change


LIVING = "zones[0] ('living')"
AIR = f"{LIVING}.channels.T_i"
NETWORK = f"{LIVING}.network"
