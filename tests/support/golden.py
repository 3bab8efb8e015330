"""Files that hold what a program gave when it was right, and the comparison with what it gives now.

The files are written anew with `make golden`, and never by hand. Another processor may round the last digit of a number
another way, so numbers may differ by a hundred-thousandth; THERMOGATE_GOLDEN=exact allows nothing, for a change that
must not change a bit on the machine that wrote the files.
"""

import os
import re
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "golden"

_MODE = os.environ.get("THERMOGATE_GOLDEN", "")
_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(?![\w.])")
_RELATIVE, _ABSOLUTE = 1e-5, 1e-9

_MASKED = (
    (re.compile(r'("(?:uptime_s|delay_s|peak_memory_MB)": ?)[\d.]+'), r"\1MASKED"),
    (re.compile(r'("ms_per_update": ?)\{[^}]*\}'), r"\1MASKED"),
    (re.compile(r'("(?:sw_version|thermogate)": ?)"[^"]*"'), r'\1"MASKED"'),
)
"""What depends on the wall clock, on this machine or on the version."""


def lines(document: str) -> str:
    """A compact JSON `document` with one key or string per line, so that a difference can be read; nothing is lost,
    because JSON itself has no line break."""
    return re.sub(r'(,|\{|\[)( ?)(?=["{])', r"\1\n\2", document)


def compare(name: str, text: str) -> None:
    """Compare `text` with the golden file `name`; with THERMOGATE_GOLDEN=write, write it instead."""
    for pattern, replacement in _MASKED:
        text = pattern.sub(replacement, text)
    path = FOLDER / name
    expected = path.read_text(encoding="utf-8") if path.exists() else ""
    shapes = [_NUMBER.sub("#", one) for one in (expected, text)]
    pairs = zip(_NUMBER.findall(expected), _NUMBER.findall(text), strict=shapes[0] == shapes[1])
    apart = [pair for pair in pairs if not alike(*pair)]
    if _MODE == "write":
        # What is alike keeps its digits, which are those of another processor.
        if apart or shapes[0] != shapes[1]:
            path.write_text(text, encoding="utf-8")
        return
    if _MODE == "exact":
        assert text == expected
    assert shapes[1] == shapes[0]
    assert apart == [], f"numbers in {path}: before, now"


def alike(before: str, now: str) -> bool:
    """Whether two numbers are written in the same way and lie close to each other."""
    if before == now:
        return True
    whole = before.lstrip("-").isdigit(), now.lstrip("-").isdigit()
    old, new = float(before), float(now)
    # The same number in other digits is another way of writing it.
    return whole == (False, False) and old != new and abs(old - new) <= max(_ABSOLUTE, _RELATIVE * abs(old))
