"""Where a Zenoh session listens and connects and what it shows there, as it is written in the configuration: the same
for the daemon's own session and for a source."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from adapters.credentials import Tls
from adapters.fields.logins import CertificatesConfig, LoginConfig
from adapters.fields.values import Endpoint, FilePath, Flag, Timeout, choice, is_loopback
from adapters.fields.words import shown
from adapters.zenoh.connection import Connection

Mode = Annotated[Literal["peer", "client", "router"], BeforeValidator(choice("peer", "client", "router"))]


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

    def session(self, access: Mapping[str, object]) -> Connection:
        """This session, with `access` as its access control."""
        return Connection(
            self.mode,
            self.connect,
            # A client listens nowhere; the daemon's own session has a default here.
            () if self.mode == "client" else self.listen,
            self.timeout,
            self.user,
            self.password_file,
            self.password_env,
            self.users_file,
            None if self.tls is None else Tls(**dict(self.tls)),
            access,
        )


def _encrypted(endpoint: str) -> bool:
    return endpoint.startswith(("tls/", "quic/"))


def _host(endpoint: str) -> str:
    return endpoint.split("/", 1)[1].rsplit(":", 1)[0]
