"""What systemd is told about the daemon: `sd_notify`(3), the datagrams of a service of `Type=notify-reload`."""

import logging
import os
import socket
import time
from collections.abc import Mapping

_log = logging.getLogger(__name__)


class Notifier:
    """Tells the service manager how the daemon is doing; where there is none, every call does nothing."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        self._address = environment.get("NOTIFY_SOCKET", "")
        if self._address.startswith("@"):
            # An abstract socket: its name begins with a zero byte, which an environment variable cannot hold.
            self._address = f"\0{self._address[1:]}"
        meant_for_us = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        usec = environment.get("WATCHDOG_USEC", "") if meant_for_us and self._address else ""
        self.watchdog = int(usec) / 1e6 if usec.isdecimal() and int(usec) else None
        """Seconds within which `alive` has to be called again and again, or None where nobody watches."""

    def starting(self, status: str, seconds: float) -> None:
        """The start goes on, as `status` says, and may take another `seconds` s."""
        self._send(f"STATUS={status}", f"EXTEND_TIMEOUT_USEC={seconds * 1e6:.0f}")

    def ready(self, status: str) -> None:
        """The start, or a reload, is over."""
        self._send("READY=1", f"STATUS={status}")

    def reloading(self) -> None:
        """The configuration is being read again; `ready` follows."""
        self._send("RELOADING=1", f"MONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def stopping(self) -> None:
        self._send("STOPPING=1", "STATUS=stopping")

    def alive(self) -> None:
        self._send("WATCHDOG=1")

    def _send(self, *assignments: str) -> None:
        if not self._address:
            return
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as channel:
                # The event loop calls this; a manager that does not read must not hold it.
                channel.setblocking(False)
                channel.sendto("\n".join(assignments).encode(), self._address)
        except OSError as error:
            _log.warning("systemd cannot be told %s (%s)", assignments[0], error.strerror)
