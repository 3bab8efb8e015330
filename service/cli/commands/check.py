"""`thermogate check`: every mistake in a configuration, explained."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from service.cli.arguments import AddCommand, load_config, take_config

if TYPE_CHECKING:
    from service.config.site import Config
    from service.recordings.history import History

_LOOKED_AT = 60 * 86400.0
"""s of a recording that are looked at: a check is no replay."""


def add_to(add: AddCommand) -> None:
    take_config(add("check", _check, "Explain every mistake in a configuration, without connecting to anything."))


def _check(arguments: argparse.Namespace) -> int:
    from service.cli.show import summary
    from service.daemon.exposure import check_exposure

    config = load_config(arguments)
    check_exposure(config)
    warnings = [*config.warnings, *_misfits(config)]
    print("\n".join([*summary(config), *(f"warning: {warning}" for warning in warnings)]))
    for history in _recorded(config):
        print("\n".join([history.described, *(f"warning: zone '{history.zone}': {one}" for one in history.doubts)]))
    return 0


def _recorded(config: Config) -> Iterable[History]:
    """What recorded files hold of the zones that they feed, at their beginning."""
    from service.recordings.history import survey

    connecting = {name for name, table in config.sources.items() if table.connects}
    zones = [zone for zone in config.zones if connecting.isdisjoint(one.source for one in zone.delivered.values())]
    return survey(config, zones, most=_LOOKED_AT).values() if zones else ()


def _misfits(config: Config) -> Iterator[str]:
    """What a start would say of stored state that does not fit, as far as that can be read."""
    from service.config.fitting import fingerprint
    from service.errors import StateMismatch
    from service.store.reading import stored_fingerprints

    stored = stored_fingerprints(config.site.state_dir)
    for zone in config.zones:
        if zone.id in stored and stored[zone.id] != fingerprint(zone):
            yield str(StateMismatch(zone.id, config.site.state_dir))
