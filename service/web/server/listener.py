"""The socket that REST is served on: an address of the network, or a file."""

import os
import socket
import stat
from pathlib import Path

from service.config.http import HttpConfig
from service.errors import ServiceError

SEND_BUFFER = 131_072
"""Bytes that the system takes for a client that does not read; left to itself it takes megabytes for each."""
SOCKET_MODE = 0o660
"""Of a UNIX socket: for the daemon's account and its group, which the proxy has to be in."""


def listener(config: HttpConfig, setting: str) -> socket.socket:
    """A socket on what `config` names, not listening yet; ServiceError, which calls the port `setting`."""
    path, family = config.socket, socket.AF_INET6 if ":" in config.host else socket.AF_INET
    # With the protocol named, asyncio turns Nagle's algorithm off; an answer would otherwise wait 40 ms.
    kind = (family, socket.SOCK_STREAM, socket.IPPROTO_TCP) if path is None else (socket.AF_UNIX, socket.SOCK_STREAM)
    bound = socket.socket(*kind)
    bound.setblocking(False)
    # The connections that are accepted inherit it.
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
    try:
        if path is None:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            bound.bind((config.host, config.port))
        else:
            if _is_left_behind(path):
                path.unlink()
            bound.bind(str(path))
            os.chmod(path, SOCKET_MODE)
    except OSError as error:
        bound.close()
        place, other = f"http: {config.host}:{config.port}", f"{setting}, or 0 for any free one"
        if path is not None:
            place, other = f"http.socket: {path}", "path"
        raise ServiceError(f"{place} cannot be used ({error.strerror or error}); choose another {other}") from error
    return bound


def _is_left_behind(path: Path) -> bool:
    """Whether there is a socket that nobody listens on any more, from a daemon that was killed."""
    try:
        if not stat.S_ISSOCK(path.stat().st_mode):
            return False
    except FileNotFoundError:
        return False
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            return True
    return False
