"""No path or key expression is built from text that nobody has checked, and no array runs code."""

import re
from pathlib import Path

import pytest
import zenoh
from hypothesis import example, given
from hypothesis import strategies as st
from support.harness import PACKAGES, ROOT

from adapters.fields.values import identifier

SOURCES = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]


def test_arrays_are_read_without_code() -> None:
    """NumPy's default. Ruff forbids the other ways from a text to code or to a statement, see `pyproject.toml`."""
    allows = re.compile(r"allow_pickle\s*=\s*(?!False)")
    assert [path for path in SOURCES if allows.search(path.read_text(encoding="utf-8"))] == []


HOSTILE = [
    *("..", ".", "a/b", "a\\b", "/etc", "~", "a\n", "a\x00", "a'--", 'a"', "*", "**", "a$*", "a?b", "a#b", "a;b", ""),
    *("%2e%2e", "living ", "ä", "A", "-a", "_a", "a" * 65, "a{b}", "a\u202e"),
]


@pytest.mark.parametrize("text", HOSTILE)
def test_what_could_do_harm_is_no_id(text: str) -> None:
    with pytest.raises(ValueError, match="cannot be an id"):
        identifier(text)


@given(
    st.text() | st.from_regex(r"[a-z0-9._/\\*$#?'\"-]{1,70}"),
    st.from_regex(r"[a-z0-9][a-z0-9_-]{0,63}", fullmatch=True),
)
@example("a\n", "a")
@example("living", "con")
def test_an_id_is_one_part_of_a_path_and_of_a_key(text: str, other: str) -> None:
    for value in (text, other):
        try:
            accepted = identifier(value)
        except ValueError:
            continue
        folder = Path("/var/lib/thermogate")
        assert (folder / accepted).parent == folder
        assert (folder / accepted).resolve().parent == folder
        key = f"thermogate/site/{accepted}/forecast"
        assert str(zenoh.KeyExpr.autocanonize(key)) == key
        assert not zenoh.KeyExpr(key).intersects(zenoh.KeyExpr("thermogate/site/another-zone/forecast"))
        assert accepted.isascii()
        assert accepted.isprintable()
