"""Addresses of web servers, as people write them."""

from collections.abc import Callable
from urllib.parse import urlsplit

from adapters.fields.values import check, text


def is_web_address(address: str) -> bool:
    """Whether `address` is the URL of a web server: http or https with a host, a port or none, and no blanks."""
    try:
        parts = urlsplit(address)
        found = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        return False
    return found and address.isprintable() and " " not in address


def web_address(example: str) -> Callable[[object], str]:
    """What takes the address of a web server, such as `example`; ValueError for anything else."""
    return check(
        lambda value: value if is_web_address(text(value)) else None, f'must be an address such as "{example}"'
    )
