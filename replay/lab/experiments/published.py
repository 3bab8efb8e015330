"""The published numbers of `published.toml`."""

import tomllib
from importlib.resources import files
from typing import Any

PUBLISHED: dict[str, dict[str, Any]] = tomllib.loads(
    files(__package__).joinpath("published.toml").read_text(encoding="utf-8")
)
CHANNELS = {"I_sol": "solar", "u_heat": "heater", "T_out": "outside"}
"""Building 67's inputs as the paper calls them, in the order of Table 4."""
