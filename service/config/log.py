"""[log]: how the daemon writes its log."""

import logging
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from adapters.fields.tables import Table
from adapters.fields.values import Count, choice

LEVELS = {name: logging.getLevelNamesMapping()[name.upper()] for name in ("debug", "info", "warning", "error")}


class LogConfig(Table):
    """Form, level, and how many lines of one kind a minute may have."""

    format: Annotated[Literal["plain", "json"], BeforeValidator(choice("plain", "json"))] = Field(
        default="plain", description="form of a line"
    )
    level: Annotated[str, BeforeValidator(choice(*LEVELS))] = Field(
        default="info", description="lowest level that is written"
    )
    limit: Count = Field(default=10, description="lines a minute of one message about one zone or source")
