"""The pages of the documentation as the tests read them."""

import re

from support.harness import ROOT

DOCS = sorted((ROOT / "docs").glob("*.md"))
TEXT = {path.name: path.read_text(encoding="utf-8") for path in DOCS}


def section(name: str, heading: str) -> str:
    """The text under a heading, up to the next one."""
    match = re.search(rf"^#+ {re.escape(heading)}\n(.*?)(?=^#+ |\Z)", TEXT[name], re.DOTALL | re.MULTILINE)
    assert match, f"{name} has no heading {heading}"
    return match[1]


def tables(text: str) -> list[list[list[str]]]:
    """Every table in `text`: rows of cells, the heading row first and without the ruler."""
    found = []
    for match in re.finditer(r"(?:^\|.*\|\n)+", text, re.MULTILINE):
        rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in match[0].splitlines()]
        found.append([[cell.strip("| ") for cell in row] for row in [rows[0], *rows[2:]]])
    assert found
    return found
