"""Checks that the options of every estimator share. Each raises OptionsError with one sentence naming the option."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TypeGuard

from estimator.errors import OptionsError


def check_known(given: Collection[str], known: Collection[str], estimator: str) -> None:
    """Refuse names that are not options."""
    for name in given:
        if name not in known:
            raise OptionsError(
                f"unknown option '{name}'; the options of '{estimator}' are {', '.join(sorted(known))}", name
            )


def checked_preset(given: Mapping[str, object], presets: Collection[str]) -> str:
    """The name of the preset that is given, "default" if none is."""
    preset = given.get("preset", "default")
    if not isinstance(preset, str) or preset not in presets:
        raise OptionsError(f"preset '{preset}' does not exist; the presets are {', '.join(presets)}", "preset")
    return preset


def checked_choice(name: str, value: object, choices: Collection[str]) -> str:
    """`value`, one of `choices`."""
    if not isinstance(value, str) or value not in choices:
        raise OptionsError(f"{name} = {value!r} must be one of {', '.join(choices)}", name)
    return value


def is_number(value: object, *, whole: bool = False) -> TypeGuard[float]:
    """Whether `value` is a number, an int if it must be `whole`; True and False are none."""
    return isinstance(value, int if whole else int | float) and not isinstance(value, bool)


def checked_number(name: str, value: object, low: float, high: float, *, whole: bool = False) -> float:
    """`value`, a number from `low` to `high`; an int if it must be `whole`."""
    if not is_number(value, whole=whole) or not low <= value <= high:
        kind = "a whole number" if whole else "a number"
        raise OptionsError(f"{name} = {value!r} must be {kind} from {low:g} to {high:g}", name)
    return value if whole else float(value)
