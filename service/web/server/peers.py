"""Whom a connection comes from."""

import ipaddress

from starlette.types import Scope as Connection

_LONGEST = 64
"""Characters of what a proxy says is an address."""


def peer_of(connection: Connection) -> str:
    """Whom a request comes from: the address, of IPv6 the /64 that one client has."""
    client = connection.get("client")
    if client is None:
        return "unknown"
    plain = plain_address(client[0])
    try:
        address = ipaddress.ip_address(plain)
    except ValueError:
        return plain[:_LONGEST]
    return plain if address.version == 4 else str(ipaddress.ip_network((int(address), 64), strict=False))


def plain_address(address: str) -> str:
    """`address`, as IPv4 where a socket for both has wrapped it into IPv6."""
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return address
    mapped = found.ipv4_mapped if isinstance(found, ipaddress.IPv6Address) else None
    return address if mapped is None else str(mapped)
