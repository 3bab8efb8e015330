"""The command line of the programs that measure or kill for longer than a test may take."""

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol


class Outcome(Protocol):
    """What came of it, as a dataclass."""

    @property
    def good(self) -> bool: ...

    def lines(self) -> list[str]: ...


def command(about: str, run: Callable[..., Outcome], **defaults: float) -> int:
    """Run with what the command line gives of `defaults`, print what came of it, and write it to --out; 1 if that is
    not good."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--out", type=Path, help="write the outcome here as JSON")
    for name, value in defaults.items():
        kind: dict[str, Any] = {"action": "store_true"} if isinstance(value, bool) else {"type": type(value)}
        parser.add_argument(f"--{name}", default=value, **kind)
    given = vars(parser.parse_args())
    out = given.pop("out")
    outcome: Any = run(**given)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(json.dumps(asdict(outcome), indent=2) + "\n", encoding="utf-8")
    print("\n".join(outcome.lines()))
    return 0 if outcome.good else 1
