"""No path, key expression or statement is built from text that nobody has checked, and no text becomes code."""

import ast
import json
import re
from pathlib import Path

import pytest
import zenoh
from hypothesis import example, given
from hypothesis import strategies as st
from support.harness import PACKAGES, ROOT

from adapters.fields.values import identifier

FILES = {str(path.relative_to(ROOT)): path for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
TEXTS = {file: path.read_text(encoding="utf-8") for file, path in FILES.items()}
SQL = re.compile(
    r"\b(SELECT .* FROM|INSERT (OR \w+ )?INTO|UPDATE \w* ?SET|DELETE FROM|PRAGMA|BEGIN|VALUES|WHERE| AND )"
)
WORDS = re.compile(r"SELECT|INSERT|UPDATE|DELETE|PRAGMA|BEGIN|VALUES|WHERE| AND ")
CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")

PARTS_OF_STATEMENTS = json.loads((ROOT / "tests" / "statements.json").read_text(encoding="utf-8"))
"""What else than constants may stand in a statement, and why that is no danger."""

FROM_LOOPS = ("table",)
"""Names that only ever run over texts written in the source."""


def test_statements_are_made_of_what_the_source_says() -> None:
    templates = 0
    for file, text in TEXTS.items():
        if not WORDS.search(text):
            continue
        tree, loops = ast.parse(text), False
        for node in ast.walk(tree):
            place = f"{file}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.JoinedStr):
                literal = "".join(str(part.value) for part in node.values if isinstance(part, ast.Constant))
                if not SQL.search(literal):
                    continue
                templates += 1
                for part in node.values:
                    if isinstance(part, ast.FormattedValue):
                        name = ast.unparse(part.value)
                        loops = loops or name in FROM_LOOPS
                        number = part.format_spec is not None and ast.unparse(part.format_spec) == "f'd'"
                        known = CONSTANT.fullmatch(name) or name in PARTS_OF_STATEMENTS or name in FROM_LOOPS or number
                        assert known, f"{place}: {name} in a statement; give it as a parameter (?)"
            pieces: list[ast.expr] = []
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Mod):
                pieces = [node.left, node.right]
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "format":
                pieces = [node.func.value]
            for piece in pieces:
                words = piece.value if isinstance(piece, ast.Constant) and isinstance(piece.value, str) else ""
                assert not SQL.search(words), f"{place}: a statement put together"
        if loops:
            assert_written_in_the_source(file, tree)
    assert templates >= 5, "the search finds them"


def assert_written_in_the_source(file: str, tree: ast.AST) -> None:
    """The loops over names of FROM_LOOPS run over texts in the source, or over constants."""
    loops = [node for node in ast.walk(tree) if isinstance(node, ast.For | ast.comprehension)]
    found = [loop.iter for loop in loops if re.search(r"\btable\b", ast.unparse(loop.target))]
    assert found, file
    for over in found:
        if CONSTANT.fullmatch(ast.unparse(over)):
            continue
        assert isinstance(over, ast.Tuple), file
        for item in over.elts:
            first = item.elts[0] if isinstance(item, ast.Tuple) else item
            constant = isinstance(first, ast.Starred) and CONSTANT.fullmatch(ast.unparse(first.value))
            assert isinstance(first, ast.Constant) or constant, file


def test_arrays_are_read_without_code() -> None:
    """NumPy's default. Ruff forbids the other ways from a text to code, see `pyproject.toml`."""
    assert [file for file, text in TEXTS.items() if re.search(r"allow_pickle\s*=\s*(?!False)", text)] == []


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
