"""Options of estimators: each is declared once, as a field of a frozen dataclass with its default and what it may be.

Whatever is wrong raises OptionsError with one sentence naming the option.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import field, fields
from typing import Any, TypeGuard, TypeVar

from estimator.errors import OptionsError
from estimator.network.network import Network

Options = TypeVar("Options")

Check = Callable[[str, object, Network], object]
"""The value of an option by its name, as given, for a network; OptionsError if it cannot be."""


def option(default: Any, check: Check) -> Any:
    """A field that may be what `check` lets through."""
    return field(default=default, metadata={"check": check})


def number(default: float, low: float, high: float) -> Any:
    """A field that is a number from `low` to `high`."""
    return option(default, lambda name, value, _: checked_number(name, value, low, high))


def whole(default: int, low: int, high: int) -> Any:
    """A field that is a whole number from `low` to `high`."""
    return option(default, lambda name, value, _: checked_number(name, value, low, high, whole=True))


def choice(default: str, *choices: str) -> Any:
    """A field that is one of `choices`."""
    return option(default, lambda name, value, _: checked_choice(name, value, choices))


def flag(default: bool) -> Any:
    """A field that is true or false."""
    return option(default, lambda name, value, _: _checked_flag(name, value))


def blocks() -> Any:
    """A field that divides the state nodes of a network into volatility blocks, or is None."""
    return option(None, lambda name, value, network: _checked_blocks(value, network))


def in_force(kind: type[Options], network: Network, values: Mapping[str, object]) -> Options:
    """The options `kind` with `values`, each checked for `network`; the others have their defaults."""
    checks: dict[str, Check] = {each.name: each.metadata["check"] for each in fields(kind) if each.metadata}  # type: ignore[arg-type]
    return kind(**{name: checks[name](name, value, network) for name, value in values.items()})


Resolve = Callable[[Network, float, Mapping[str, object]], Options]


def resolver(
    kind: type[Options], estimator: str, usual: Callable[..., Mapping[str, object]] = lambda *_: {}
) -> Resolve[Options]:
    """What gives the options `kind` of an estimator that are in force for a network at a period in s: those that are
    `usual` there, then what is given.

    It raises OptionsError with one sentence naming the option that is wrong.
    """

    def resolve(network: Network, period: float, given: Mapping[str, object]) -> Options:
        check_known(given, names(kind), estimator)
        return in_force(kind, network, {**usual(network, period, given), **given})

    return resolve


def check_known(given: Collection[str], known: Collection[str], estimator: str) -> None:
    """Refuse names that are not options."""
    for name in given:
        if name not in known:
            raise OptionsError(
                f"unknown option '{name}'; the options of '{estimator}' are {', '.join(sorted(known))}", name
            )


def names(kind: type[Any]) -> set[str]:
    """The names of the options `kind`."""
    return {each.name for each in fields(kind)}


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


def check_order(options: object, *pairs: tuple[str, str], equal: bool = False) -> None:
    """Refuse options of which the first of a pair is not below the second, or with `equal` above it."""
    for low, high in pairs:
        lower, upper = getattr(options, low), getattr(options, high)
        if lower > upper or (lower == upper and not equal):
            what = "must not be above" if equal else "must be below"
            raise OptionsError(f"{low} = {lower:g} {what} {high} = {upper:g}", low, high)


def check_start(options: Any) -> None:
    """Refuse bounds of alpha without the 1 at which the volatility starts."""
    alphas = ("alpha_min", "alpha_max")
    if not options.alpha_min <= 1.0 <= options.alpha_max:
        raise OptionsError(
            "alpha_min and alpha_max must have 1, where the volatility starts, between them",
            *(alphas if options.alpha_min > 1.0 else reversed(alphas)),
        )


def _checked_flag(name: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise OptionsError(f"{name} = {value!r} must be true or false", name)
    return value


def _checked_blocks(value: object, network: Network) -> dict[str, tuple[str, ...]] | None:
    """Volatility blocks by name, which together name every state node once; None stays None."""
    if value is None:
        return None
    if not isinstance(value, Mapping) or not value:
        raise OptionsError("volatility_blocks must be a table of block name = [state nodes]", "volatility_blocks")
    blocks = {str(name): tuple(nodes) if isinstance(nodes, list | tuple) else () for name, nodes in value.items()}
    listed = [node for nodes in blocks.values() for node in nodes]
    if sorted(map(str, listed)) != sorted(network.nodes) or not all(blocks.values()):
        raise OptionsError(
            "volatility_blocks must name every state node exactly once; "
            f"the state nodes are {', '.join(network.nodes)}",
            "volatility_blocks",
        )
    return blocks
