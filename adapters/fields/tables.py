"""What every table of the configuration has in common."""

from pydantic import BaseModel, ConfigDict


class Table(BaseModel):
    """Unknown keys are mistakes, and a table that was read does not change."""

    model_config = ConfigDict(extra="forbid", frozen=True)
