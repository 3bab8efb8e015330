"""`thermogate keys`: create, list and revoke the keys that REST is opened with."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from service.cli.arguments import AddCommand, load_config, require_zones, take_config

if TYPE_CHECKING:
    from service.config.site import Config


def add_to(add: AddCommand) -> None:
    parser = add("keys", _keys, "Create, list or revoke the API keys of a daemon, which may be running.")
    parser.add_argument("action", choices=("create", "list", "revoke"), help="what to do")
    take_config(parser)
    parser.add_argument("name", nargs="?", metavar="NAME", help="name of the key, an id such as grafana")
    parser.add_argument(
        "--scope",
        choices=("read", "write", "admin"),
        help="create: read: what is served; write: only to post readings; admin: everything",
    )
    zone = "create: for this zone only; may be given several times"
    parser.add_argument("--zone", action="append", metavar="ID", help=zone)
    parser.add_argument(
        "--expires", metavar="WHEN", help="create: a duration such as 90d, or an RFC 3339 time (default: never)"
    )


def _keys(arguments: argparse.Namespace) -> int:
    from service.errors import ConfigError

    if mistake := _mistake(arguments):
        raise ConfigError([mistake])
    action: Callable[[Config, argparse.Namespace], None]
    action = {"create": _create, "list": _list, "revoke": _revoke}[arguments.action]
    action(load_config(arguments), arguments)
    return 0


def _mistake(arguments: argparse.Namespace) -> str | None:
    """What is wrong with the command, before anything is read."""
    action = arguments.action
    if action == "list" and arguments.name is not None:
        return "keys list shows all keys; leave the name out"
    if action != "list" and arguments.name is None:
        return f"keys {action} needs the name of the key, as in: thermogate keys {action} CONFIG grafana"
    if action == "create":
        if arguments.scope is None:
            return "keys create needs --scope read, --scope write or --scope admin"
        if arguments.scope == "admin" and arguments.zone is not None:
            return "--zone goes with --scope read or write; a key for administration sees all zones"
        return None
    options = ("scope", "zone", "expires")
    return next((f"--{one} is for keys create" for one in options if getattr(arguments, one) is not None), None)


def _create(config: Config, arguments: argparse.Namespace) -> None:
    import sys

    from adapters.fields.values import identifier
    from service.errors import ConfigError
    from service.store.audit import note
    from service.web.keys import create_key, read_keys

    zones = None if arguments.zone is None else list(dict.fromkeys(arguments.zone))
    require_zones(config, zones or (), "--zone")
    try:
        name = identifier(arguments.name)
    except ValueError as error:
        raise ConfigError([f"NAME: {error}"]) from None
    expires = None if arguments.expires is None else _expiry(arguments.expires)
    first = not read_keys(config.keys_file)
    secret = create_key(config.keys_file, name, arguments.scope, zones, expires)
    note(config.site.state_dir, "key", f"key '{name}' with the scope {arguments.scope} is created")
    if first:
        print("from this first key on, REST is not read without one, not even on this machine", file=sys.stderr)
    print(f"key '{name}' is in {config.keys_file}; this is the only time that it is shown:", file=sys.stderr)
    print(secret)


def _expiry(text: str) -> datetime:
    """The UTC time that a duration from now or an RFC 3339 time means; ConfigError if it is neither, or past."""
    from adapters.fields.durations import parse_duration
    from adapters.fields.times import ZoneMissing, parse_time
    from service.errors import ConfigError

    now = datetime.now(UTC).replace(microsecond=0)
    try:
        try:
            expires = now + timedelta(seconds=parse_duration(text))
        except ValueError:
            expires = parse_time(text)
        wrong = None if expires > now else "is not in the future"
    except ZoneMissing:
        wrong = "has no time zone; end it with Z for UTC"
    except ValueError:
        wrong = "is neither a duration such as 90d nor a time such as 2030-01-31T00:00:00Z"
    if wrong:
        raise ConfigError([f'--expires: "{text}" {wrong}'])
    return expires


def _list(config: Config, arguments: argparse.Namespace) -> None:
    from adapters.fields.times import written_time
    from service.cli.tables import aligned
    from service.web.keys import read_keys

    now, rows = datetime.now(UTC), [("name", "scope", "zones", "created", "expires", "state")]
    for key in read_keys(config.keys_file):
        zones = "all" if key.zones is None else ", ".join(key.zones)
        expires = "never" if key.expires is None else written_time(key.expires)
        rows.append((key.name, key.scope, zones, written_time(key.created), expires, key.state(now)))
    print("\n".join(aligned(rows)) if len(rows) > 1 else f"no keys in {config.keys_file}")


def _revoke(config: Config, arguments: argparse.Namespace) -> None:
    from service.store.audit import note
    from service.web.keys import revoke_key

    revoke_key(config.keys_file, arguments.name)
    note(config.site.state_dir, "key", f"key '{arguments.name}' is revoked")
    print(f"key '{arguments.name}' is revoked; a running daemon refuses it from now on")
