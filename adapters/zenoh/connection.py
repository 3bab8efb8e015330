"""Where a Zenoh session listens and connects, what it shows there and whom it lets do what, as Zenoh's settings.

It listens and connects where it is told and nowhere else: no multicast scouting, no gossip.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from adapters.credentials import Tls, password, tls_problems, unreadable

_LONGEST_PAUSE_MS = 30_000
_TLS = "transport/link/tls"
_USER = "transport/auth/usrpwd"


@dataclass(frozen=True)
class Connection:
    """Where the session listens and connects, and who it says it is. The password is in a file or in an environment
    variable; `users_file` has a line "user:password" for everyone who may connect to us."""

    mode: str = "client"
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    timeout: float = 5.0
    user: str | None = None
    password_file: Path | None = None
    password_env: str | None = None
    users_file: Path | None = None
    tls: Tls | None = None
    access: Mapping[str, object] = field(default_factory=dict)
    """Zenoh's `access_control`; nothing is checked if it is empty."""

    @property
    def place(self) -> str:
        """Where it leads to."""
        return ", ".join((*self.connect, *(f"listening on {endpoint}" for endpoint in self.listen)))

    def problems(self) -> Iterator[str]:
        """What is wrong with the files it names, one sentence each."""
        for name, path in (("password_file", self.password_file), ("users_file", self.users_file)):
            if path is not None and (reason := unreadable(path)):
                yield f"{name}: {path} cannot be read ({reason})"
        if self.tls is not None:
            yield from tls_problems(self.tls)

    def settings(self) -> dict[str, object]:
        """The session's settings by their keys in Zenoh; SourceConfigError if the password cannot be had."""
        settings: dict[str, object] = {
            "mode": self.mode,
            # Without this line a peer would listen on every address of the machine.
            "listen/endpoints": list(self.listen),
            "listen/exit_on_failure": True,
            "connect/endpoints": list(self.connect),
            # For one attempt at one endpoint; a client that gave all of its time to the first would never try the next.
            "transport/unicast/open_timeout": int(1000 * self.timeout),
            "connect/retry": {"period_init_ms": 500, "period_max_ms": _LONGEST_PAUSE_MS, "period_increase_factor": 2},
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
        }
        if self.access:
            settings["access_control"] = dict(self.access)
        if self.user is not None:
            settings |= {
                f"{_USER}/user": self.user,
                f"{_USER}/password": password(self.password_file, self.password_env),
            }
        if self.users_file is not None:
            settings[f"{_USER}/dictionary_file"] = str(self.users_file)
        tls = self.tls
        if tls is not None:
            settings[f"{_TLS}/verify_name_on_connect"] = tls.verify_name
            if tls.ca is not None:
                settings[f"{_TLS}/root_ca_certificate"] = str(tls.ca)
            if tls.certificate is not None:
                settings[f"{_TLS}/enable_mtls"] = tls.mutual
                settings[f"{_TLS}/close_link_on_expiration"] = True
                for side in ("connect", "listen"):
                    settings[f"{_TLS}/{side}_certificate"] = str(tls.certificate)
                    settings[f"{_TLS}/{side}_private_key"] = str(tls.private_key)
        return settings
