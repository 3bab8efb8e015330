"""Configurations: any file is read or refused in sentences, and what is read can be shown and read again."""

import copy
import shutil
import tomllib
from pathlib import Path
from typing import Any

import tomli_w
from fuzz.fuzzing import folder, raw, structured
from hypothesis import strategies as st

from service.cli.show import summary
from service.config.fitting import fingerprint, make_alignment
from service.config.load import load
from service.config.overrides import apply_overrides
from service.config.written import effective_toml
from service.errors import ConfigError

EXAMPLES = Path(__file__).parents[2] / "deploy" / "examples"
FOLDER = folder()
shutil.copytree(EXAMPLES / "data", FOLDER / "data")
TEXTS = {path.name: path.read_bytes() for path in sorted(EXAMPLES.glob("*.toml"))}
RAW = {name: tomllib.loads(text.decode()) for name, text in TEXTS.items()}


def sentences(error: ConfigError) -> None:
    assert error.problems
    for problem in error.problems:
        assert problem.isprintable()
        assert ": " in problem
        assert "Input should" not in problem


def outcome(content: bytes) -> None:
    """A Config that can be shown and built from, or sentences of one line each."""
    path = FOLDER / "fuzz.toml"
    path.write_bytes(content)
    try:
        config = load(path)
    except ConfigError as error:
        sentences(error)
        return
    summary(config)
    for zone in config.zones:
        fingerprint(zone)
        make_alignment(zone)
    shown = effective_toml(config)
    path.write_text(shown, encoding="utf-8")
    assert effective_toml(load(path)) == shown


@raw(*TEXTS.values(), b"[site]\nid = 1979-05-27\n", b"a = [[[[", examples=150)
def test_config_file(data: bytes) -> None:
    outcome(data)


@raw(b"http.port=8081", b"zones.living.period=10min", b'sources."a.b".files=["x"]', b"zones.0.channels=")
def test_override(data: bytes) -> None:
    text = data.decode("utf-8", "replace")
    for tables in RAW.values():
        try:
            apply_overrides(tables, [text])
        except ConfigError as error:
            sentences(error)


VALUES = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(),
    st.text(max_size=12),
    st.dates(),
    st.datetimes(),
    st.times(),
    st.lists(st.one_of(st.integers(), st.text(max_size=3)), max_size=3),
    st.dictionaries(st.text(max_size=4), st.integers(), max_size=2),
    st.sampled_from(["rbpf", "ekf", "ukf", "paper", "titeth", "tite", "first", "energy", "%", "kWh", "K", "1s", "0s"]),
    st.sampled_from([0, 1, -1, 0.5, 2, 1e-300, 1e300, 65535, "*", "senml", "holding", "tls/0.0.0.0:7447", "../x", "/"]),
)


def places(table: Any, place: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Every place in `table`."""
    items = table.items() if isinstance(table, dict) else enumerate(table) if isinstance(table, list) else ()
    return [one for key, value in items for one in ((*place, key), *places(value, (*place, key)))]


@structured(
    examples=120,
    name=st.sampled_from(sorted(RAW)),
    changes=st.lists(
        st.tuples(
            st.sampled_from(["set", "remove", "copy", "swap", "add", "text"]), st.integers(0), st.integers(0), VALUES
        ),
        min_size=1,
        max_size=4,
    ),
    key=st.one_of(st.text(max_size=5), st.sampled_from(["lateness", "writers", "seed", "valid", "preset", "levels"])),
)
def test_changed_example(name: str, changes: list[tuple[str, int, int, Any]], key: str) -> None:
    """An example with keys of its own removed, moved, or given other values of every kind."""
    tables = copy.deepcopy(RAW[name])
    for kind, where, other, value in changes:
        known = places(tables)
        if known:
            _change(tables, kind, known[where % len(known)], known[other % len(known)], key, value)
    outcome(tomli_w.dumps(tables).encode())


def _change(tables: Any, kind: str, place: tuple[Any, ...], other: tuple[Any, ...], key: str, value: Any) -> None:
    owner, last = _at(tables, place[:-1]), place[-1]
    source = copy.deepcopy(_at(tables, other))
    if kind == "remove":
        del owner[last]
    elif kind == "copy":
        owner[last] = source
    elif kind == "swap" and place[: len(other)] != other and other[: len(place)] != place:
        owner[last], _at(tables, other[:-1])[other[-1]] = source, owner[last]
    elif kind == "add" and isinstance(owner[last], dict):
        owner[last][key] = value
    elif kind == "text" and isinstance(owner[last], str):
        owner[last] += str(value)
    else:
        owner[last] = value


def _at(table: Any, place: tuple[Any, ...]) -> Any:
    for key in place:
        table = table[key]
    return table
