"""Names in the database: the schema of a site; and how the state of a zone is given up."""

from __future__ import annotations

import zlib

_LONGEST = 63
"""Bytes that PostgreSQL takes of a name; the rest it leaves out in silence."""


RESET = "as docs/operations.md tells under 'A site in PostgreSQL', by SQL"
"""How the state of a zone is given up in a fleet."""


def schema_of(site: str) -> str:
    """The schema that holds the tables of `site`."""
    name = f"thermogate_{site}"
    if len(name.encode()) <= _LONGEST:
        return name
    return f"{name[: _LONGEST - 9]}_{zlib.crc32(site.encode()):08x}"
