"""JSON pointers, by the examples of RFC 6901 section 5."""

import pytest

from adapters.payload.json_pointer import MISSING, parse, resolve

DOCUMENT = {
    "foo": ["bar", "baz"],
    "": 0,
    "a/b": 1,
    "c%d": 2,
    "e^f": 3,
    "g|h": 4,
    "i\\j": 5,
    'k"l': 6,
    " ": 7,
    "m~n": 8,
}


@pytest.mark.parametrize(
    ("pointer", "value"),
    [
        ("", DOCUMENT),
        ("/foo", ["bar", "baz"]),
        ("/foo/0", "bar"),
        ("/", 0),
        ("/a~1b", 1),
        ("/c%d", 2),
        ("/e^f", 3),
        ("/g|h", 4),
        ("/i\\j", 5),
        ('/k"l', 6),
        ("/ ", 7),
        ("/m~0n", 8),
    ],
)
def test_the_examples_of_the_standard(pointer, value):
    assert resolve(DOCUMENT, parse(pointer)) == value


def test_an_escaped_tilde_is_not_escaped_twice():
    assert parse("/~01") == ("~1",)


@pytest.mark.parametrize(
    "pointer", ["/nothing", "/foo/2", "/foo/-", "/foo/01", "/foo/bar", "/foo/0/0", "/a/b", "/foo/-1"]
)
def test_what_is_not_there_is_missing(pointer):
    assert resolve(DOCUMENT, parse(pointer)) is MISSING


@pytest.mark.parametrize("pointer", ["value", "#/value", "/a~b", "/a~"])
def test_what_is_no_pointer_is_refused_in_one_sentence(pointer):
    with pytest.raises(ValueError, match=r"is no JSON pointer; .+"):
        parse(pointer)
