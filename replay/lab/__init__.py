"""The laboratory: the paper's experiments. For a checkout; no wheel carries it."""

from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "deploy" / "examples"
"""Configurations and a controller as users are given them."""
