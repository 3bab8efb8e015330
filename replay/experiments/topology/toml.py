"""The network that was found as a table of the configuration, tried by the rules of `thermogate check`."""

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from estimator.arrays import Array
from estimator.network.network import Network, Parameter
from service.config.load import load
from service.config.overrides import apply_overrides
from service.config.written import network_table
from service.errors import ConfigError

AROUND = 5.0
"""The box of a learned parameter spans from a fifth to five times what was fitted: the fit saw only this recording,
and heat that nobody measured is in it."""


class Place(NamedTuple):
    """A zone of a configuration file, with the changes of the command line."""

    config: Path
    overrides: Sequence[str]
    zone: str
    running: bool = False
    """Whether it is the copy that a running daemon keeps, and not the file that its operator edits."""

    @property
    def named(self) -> str:
        """How the file is called towards its operator."""
        return "the daemon's configuration" if self.running else self.config.name


def proposal(network: Network, theta: Array, at_bound: Sequence[str]) -> Network:
    """`network` with boxes around `theta` (n_theta,); a parameter at a bound keeps the box it had, within which the
    data could not place it."""
    parameters = tuple(
        _around(parameter, float(value)) if parameter.free and parameter.name not in at_bound else parameter
        for parameter, value in zip(network.parameters, theta, strict=True)
    )
    return replace(network, parameters=parameters).validate()


def _around(parameter: Parameter, value: float) -> Parameter:
    rounded = float(f"{value:.3g}")
    lower, upper = float(f"{rounded / AROUND:.3g}"), float(f"{rounded * AROUND:.3g}")
    if parameter.unit == "1":
        # A share stays one.
        lower, upper = max(lower, parameter.lower), min(upper, parameter.upper)
    return replace(parameter, lower=min(lower, rounded), upper=max(upper, rounded), nominal=rounded)


def network_toml(network: Network, reason: str, place: Place | None) -> str:
    """The [zones.network] table of `network`, under a comment that says why and where it goes, and, tried in the
    configuration at `place`, what else in the zone would have to change."""
    table = network_table(network)
    lines = [f"# {reason}"]
    if place is not None:
        superfluous, objections = _tried(table, network, place)
        lines.append(f'# In zone "{place.zone}" of {place.named}: below its channels, instead of its network.')
        if superfluous:
            lines.append(f"# It does not use {', '.join(superfluous)}: remove that from the zone's channels.")
        lines += [f"# To be changed as well: {objection}" for objection in objections]
    return "\n".join([*lines, tomli_w.dumps({"zones": {"network": table}})])


def _tried(table: Mapping[str, Any], network: Network, place: Place) -> tuple[list[str], list[str]]:
    """Channels of the zone that `network` does not need, and what `load` still objects to with the others."""
    raw = apply_overrides(tomllib.loads(place.config.read_bytes().decode("utf-8-sig")), place.overrides)
    channels = next(zone["channels"] for zone in raw["zones"] if zone.get("id") == place.zone)
    kept = {name: channel for name, channel in channels.items() if name in network.channels}
    zone = f"zones.{place.zone}"
    changes = (f"{zone}.network={_inline(table)}", f"{zone}.channels={_inline(kept)}")
    try:
        load(place.config, (*place.overrides, *changes))
    except ConfigError as error:
        objections = list(error.problems)
    else:
        objections = []
    return [name for name in channels if name not in kept], objections


def _inline(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(key)} = {_inline(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_inline(item) for item in value) + "]"
    return tomli_w.dumps({"v": value}).removeprefix("v = ").strip()
