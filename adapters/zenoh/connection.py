"""How a Zenoh session listens, connects and is known, the daemon's own or a source's: only where and as it is told."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from adapters.fields.logins import CertificatesConfig, LoginConfig, unreadable
from adapters.fields.values import Endpoint, FilePath, Flag, Timeout, choice, is_loopback
from adapters.fields.words import shown

Mode = Annotated[Literal["peer", "client", "router"], BeforeValidator(choice("peer", "client", "router"))]

_LONGEST_PAUSE_MS = 30_000
_TLS = "transport/link/tls"
_USER = "transport/auth/usrpwd"


class TlsConfig(CertificatesConfig):
    """tls of a Zenoh session."""

    mutual: Flag = Field(default=True, description="with a certificate: both sides show one")


class SessionConfig(LoginConfig):
    """What every table of a Zenoh session has."""

    mode: Mode = Field(description="role of the session")
    connect: tuple[Endpoint, ...] = Field(
        default=(), description='a list of endpoints, such as ["tcp/192.168.1.30:7447"]'
    )
    listen: tuple[Endpoint, ...] = Field(default=(), description='a list of endpoints, such as ["tcp/127.0.0.1:7449"]')
    timeout: Timeout = Field(default=5.0, description="time limit for one attempt to connect")
    users_file: FilePath | None = Field(default=None, description="who may connect here: lines `user:password`")
    tls: TlsConfig | None = Field(default=None, description="certificates")

    @model_validator(mode="after")
    def _known(self) -> Self:
        for endpoint in self.listen:
            if _encrypted(endpoint) and (self.tls is None or self.tls.certificate is None):
                raise ValueError(f"listening on {endpoint} needs tls.certificate and tls.private_key")
            if not is_loopback(_host(endpoint)) and not self.knows(endpoint):
                raise ValueError(
                    f"listening on {shown(endpoint)}, which is not a loopback address, lets other machines in: give "
                    "users_file, or listen on tls with tls.ca, tls.certificate and tls.private_key and mutual = true"
                )
        return self

    def knows(self, endpoint: str) -> bool:
        """Whether who connects to us at `endpoint` has to show a password or a certificate."""
        tls = self.tls
        mutual = tls is not None and tls.mutual and tls.ca is not None and tls.certificate is not None
        return self.users_file is not None or (_encrypted(endpoint) and mutual)

    @property
    def listening(self) -> tuple[str, ...]:
        """Where it listens; a client nowhere, whatever the default."""
        return () if self.mode == "client" else self.listen

    @property
    def place(self) -> str:
        return ", ".join((*self.connect, *(f"listening on {endpoint}" for endpoint in self.listening)))

    def problems(self) -> Iterator[str]:
        yield from super().problems()
        if self.users_file is not None and (reason := unreadable(self.users_file)):
            yield f"users_file: {self.users_file} cannot be read ({reason})"
        if self.tls is not None:
            yield from self.tls.problems()

    def settings(self, access: Mapping[str, object]) -> dict[str, object]:
        """The session's settings by their keys in Zenoh, with `access` as its access control; SourceConfigError if the
        password cannot be had."""
        user, secret = self.credentials()
        settings: dict[str, object] = {
            "mode": self.mode,
            # Without this line a peer would listen on every address of the machine.
            "listen/endpoints": list(self.listening),
            "listen/exit_on_failure": True,
            "connect/endpoints": list(self.connect),
            # For one attempt at one endpoint; a client that gave all of its time to the first would never try the next.
            "transport/unicast/open_timeout": int(1000 * self.timeout),
            "connect/retry": {"period_init_ms": 500, "period_max_ms": _LONGEST_PAUSE_MS, "period_increase_factor": 2},
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "access_control": dict(access),
        }
        if user is not None:
            settings |= {f"{_USER}/user": user, f"{_USER}/password": secret}
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


def _encrypted(endpoint: str) -> bool:
    return endpoint.startswith(("tls/", "quic/"))


def _host(endpoint: str) -> str:
    return endpoint.split("/", 1)[1].rsplit(":", 1)[0]
