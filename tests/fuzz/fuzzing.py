"""What a fuzz target is: a property of any input, tried with few inputs by `make test` and with many by `make fuzz`.

A target fails by raising anything, in `make fuzz` also by taking SECONDS for an input.
"""

import atexit
import os
import random
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

Check = Callable[[bytes], object]

TIMES = float(os.environ.get("FUZZ_TIMES", "0.5"))
"""How many times its examples every target is tried with; `make test` takes half of them."""

SECONDS = 20


def folder() -> Path:
    """A new folder, which goes when the process does."""
    made = Path(tempfile.mkdtemp(prefix="thermogate-fuzz-"))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return made


def raw(*seeds: bytes, examples: int = 400) -> Callable[[Check], Callable[[], None]]:
    """A target that takes bytes as they are; `seeds` are good ones to begin with."""
    return structured(examples, data=spoilt(seeds))


def structured(examples: int = 100, **strategies: st.SearchStrategy[Any]) -> Callable[[Any], Any]:
    """A target whose arguments are drawn from `strategies`: the same ones in every `make test`."""
    few = settings(
        max_examples=round(examples * TIMES),
        deadline=None if TIMES < 1 else 1000 * SECONDS,
        derandomize=TIMES < 1,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    return lambda check: few(given(**strategies)(check))


def spoilt(seeds: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """Any bytes, or one of `seeds` with some of its bytes changed, left out, doubled or moved."""
    if not seeds:
        return st.binary(max_size=400)
    mutations = st.integers(0, 2**32 - 1)
    return st.one_of(st.builds(_mutated, st.sampled_from(list(seeds)), mutations), st.binary(max_size=400))


_INTERESTING = (*(b"\x00", b"\xff", b"\n", b"\xed\xa0\x80", b"\\ud800"), *b"nan inf - 1e999 null [ {".split(), b'"')


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
