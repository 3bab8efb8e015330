"""JSON pointers, by the examples of RFC 6901 section 5."""

import pytest

from adapters.payload.json_pointer import MISSING, parse, resolve

BY_NAME = {"": 0, "a/b": 1, "c%d": 2, "e^f": 3, "g|h": 4, "i\\j": 5, 'k"l': 6, " ": 7, "m~n": 8}
DOCUMENT = {"foo": ["bar", "baz"], **BY_NAME}


def test_the_examples_of_the_standard():
    pointers = ("/", "/a~1b", "/c%d", "/e^f", "/g|h", "/i\\j", '/k"l', "/ ", "/m~0n")
    assert [resolve(DOCUMENT, parse(pointer)) for pointer in pointers] == list(BY_NAME.values())
    found = [resolve(DOCUMENT, parse(pointer)) for pointer in ("", "/foo", "/foo/0")]
    assert found == [DOCUMENT, ["bar", "baz"], "bar"]
    assert parse("/~01") == ("~1",), "an escaped tilde is not escaped twice"


@pytest.mark.parametrize(
    "pointer", ["/nothing", "/foo/2", "/foo/-", "/foo/01", "/foo/bar", "/foo/0/0", "/a/b", "/foo/-1"]
)
def test_what_is_not_there_is_missing(pointer):
    assert resolve(DOCUMENT, parse(pointer)) is MISSING


@pytest.mark.parametrize("pointer", ["value", "#/value", "/a~b", "/a~"])
def test_what_is_no_pointer_is_refused_in_one_sentence(pointer):
    with pytest.raises(ValueError, match=r"is no JSON pointer; .+"):
        parse(pointer)
