"""What a fuzz target is: a property of any input, run briefly by pytest and at length by `make fuzz`.

A target of raw bytes is led by coverage alone; a structured one draws its input by Hypothesis' strategies, whose
choices are then made from those bytes. A target fails by raising anything.
"""

from __future__ import annotations

import atexit
import random
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

Check = Callable[[bytes], object]


class Target(NamedTuple):
    """`run` takes one input and returns None where the bytes made none; `share` is its part of all inputs.

    A target without `run`, because what it tests runs elsewhere where coverage is not seen, has Hypothesis draw the
    arguments of `check` from `strategies`.
    """

    name: str
    share: int
    run: Check | None
    check: Callable[..., object]
    strategies: Mapping[str, st.SearchStrategy[Any]]
    seeds: tuple[bytes, ...] = ()


TARGETS: dict[str, Target] = {}


def folder() -> Path:
    """A new folder, which goes when the process does."""
    made = Path(tempfile.mkdtemp(prefix="thermogate-fuzz-"))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return made


def raw(*seeds: bytes, share: int, examples: int = 400) -> Callable[[Check], Callable[[], None]]:
    """A target that takes bytes as they are; `seeds` are good ones to begin with."""

    def register(check: Check) -> Callable[[], None]:
        def run(data: bytes) -> bool:
            check(data)
            return True

        name = check.__name__.removeprefix("test_")
        drawn = {"data": spoilt(seeds)}
        TARGETS[name] = Target(name, share, run, check, drawn, seeds)
        return _briefly(examples)(given(**drawn)(_named(check)))

    return register


def structured(
    share: int, examples: int = 100, led: bool = True, **strategies: st.SearchStrategy[Any]
) -> Callable[[Any], Any]:
    """A target whose arguments are drawn from `strategies`."""

    def register(check: Any) -> Any:
        test = _briefly(examples)(given(**strategies)(check))
        name = check.__name__.removeprefix("test_")
        TARGETS[name] = Target(name, share, test.hypothesis.fuzz_one_input if led else None, check, strategies)
        return test

    return register


def _briefly(examples: int) -> Callable[[Any], Any]:
    """The same inputs in every run of the tests; new ones are what `make fuzz` is for."""
    return settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


def _named(check: Check) -> Any:
    def test(data: bytes) -> None:
        check(data)

    test.__name__, test.__doc__, test.__module__ = check.__name__, check.__doc__, check.__module__
    test.__qualname__ = check.__name__
    return test


def spoilt(seeds: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """Any bytes, or one of `seeds` with some of its bytes changed, left out, doubled or moved."""
    if not seeds:
        return st.binary(max_size=400)
    mutations = st.integers(0, 2**32 - 1)
    return st.one_of(st.builds(_mutated, st.sampled_from(list(seeds)), mutations), st.binary(max_size=400))


_INTERESTING = (
    b"\x00",
    b"\xff",
    b"nan",
    b"inf",
    b"-",
    b"1e999",
    b"null",
    b"[",
    b"{",
    b'"',
    b"\n",
    b"\xed\xa0\x80",
    b"\\ud800",
)


def _mutated(seed: bytes, key: int) -> bytes:
    choose = random.Random(key)
    data = bytearray(seed)
    for _ in range(choose.randint(0, 6)):
        place = choose.randint(0, len(data))
        match choose.randint(0, 4):
            case 0:
                data[place:place] = choose.choice(_INTERESTING)
            case 1:
                del data[place : place + choose.randint(1, 8)]
            case 2 if data:
                data[place % len(data)] = choose.randint(0, 255)
            case 3:
                data[place:place] = data[: choose.randint(0, 40)]
            case _:
                data = data[: place + 1]
    return bytes(data)
