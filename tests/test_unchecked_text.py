"""No path, key expression or statement is built from text that nobody has checked, and no text becomes code."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from hypothesis import example, given
from hypothesis import strategies as st
from support.harness import PACKAGES, ROOT

from adapters.fields.values import identifier

FILES = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
TREES = {str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8")) for path in FILES}

SQL = re.compile(
    r"\b(SELECT .* FROM|INSERT (OR \w+ )?INTO|UPDATE \w* ?SET|DELETE FROM|PRAGMA|BEGIN|VALUES|WHERE| AND )"
)
CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")

PARTS_OF_STATEMENTS = {
    "condition": "from a list of conditions that the function itself writes, with ? for the values",
    "where": "joined from such conditions",
    "into": "a table and its columns, which the caller's module itself writes",
    "otherwise": "such a module's words for rows that are there already",
    "statements": "the schema, which the module itself writes",
    "places": "question marks",
    "link": "a column of one table that the others do not have",
    "field": "of a question to InfluxDB, from the operator's own configuration: one that cannot end it or write",
    "source": "likewise",
}
"""What else than constants may stand in a statement, and why that is no danger."""

FROM_LOOPS = ("table",)
"""Names that only ever run over texts written in the source."""


def sql_templates() -> Iterator[tuple[str, ast.JoinedStr]]:
    for file, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                literal = "".join(str(part.value) for part in node.values if isinstance(part, ast.Constant))
                if SQL.search(literal):
                    yield file, node


def test_statements_are_made_of_what_the_source_says() -> None:
    templates = list(sql_templates())
    assert len(templates) >= 5, "the search finds them"
    for file, node in templates:
        for part in node.values:
            if isinstance(part, ast.FormattedValue):
                text = ast.unparse(part.value)
                number = part.format_spec is not None and ast.unparse(part.format_spec) == "f'd'"
                known = CONSTANT.fullmatch(text) or text in PARTS_OF_STATEMENTS or text in FROM_LOOPS or number
                assert known, f"{file}:{node.lineno}: {text} in a statement; give it as a parameter (?)"


def test_statements_are_not_put_together_otherwise() -> None:
    for file, tree in TREES.items():
        for node in ast.walk(tree):
            pieces: list[ast.expr] = []
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Mod):
                pieces = [node.left, node.right]
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "format":
                pieces = [node.func.value]
            for piece in pieces:
                text = piece.value if isinstance(piece, ast.Constant) and isinstance(piece.value, str) else ""
                assert not SQL.search(text), f"{file}:{node.lineno}: a statement put together"


def test_names_of_tables_are_written_in_the_source() -> None:
    users = {
        file for file, node in sql_templates() for part in node.values
        if isinstance(part, ast.FormattedValue) and ast.unparse(part.value) in FROM_LOOPS
    }  # fmt: skip
    assert users
    for file in users:
        loops = [node for node in ast.walk(TREES[file]) if isinstance(node, ast.For | ast.comprehension)]
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


@pytest.mark.parametrize("package", ["estimator", "adapters", "service"])
def test_no_text_becomes_code(package: str) -> None:
    forbidden = {"eval", "exec", "system", "popen", "Popen", "check_output"}
    for file, tree in TREES.items():
        if not file.startswith(f"{package}/"):
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
                assert name not in forbidden, f"{file}:{node.lineno}: {name}"
                keywords = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
                assert keywords.get("shell") is None, f"{file}:{node.lineno}"
                if ast.unparse(node.func) in ("np.load", "np.lib.format.read_array"):
                    assert keywords["allow_pickle"] == "False", f"{file}:{node.lineno}"
            if isinstance(node, ast.Import | ast.ImportFrom):
                module = getattr(node, "module", None)
                modules = {module} if module else {alias.name for alias in node.names}
                assert not modules & {"pickle", "marshal", "shelve", "subprocess", "yaml"}, f"{file}:{node.lineno}"


ID = r"[a-z0-9][a-z0-9_-]{0,63}"
NEARLY = r"[a-z0-9._/\\*$#?'\"-]{1,70}"
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
