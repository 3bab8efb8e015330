"""Names as a sentence shows them."""

from __future__ import annotations

import pytest

from adapters.fields.words import listed


@pytest.mark.parametrize(
    ("count", "said"),
    [(0, ""), (1, "r0"), (3, "r0, r1, r2"), (4, "r0, r1, r2 and 1 more"), (9, "r0, r1, r2 and 6 more")],
)
def test_of_many_names_the_first_are_shown(count: int, said: str) -> None:
    assert listed([f"r{number}" for number in range(count)], 3) == said
