"""What every table of the configuration has in common."""

from pydantic import ConfigDict

TABLE = ConfigDict(extra="forbid", frozen=True)
"""Unknown keys are mistakes, and a table that was read does not change."""
