"""Where a broker is, how it is reached, and who connects to it."""

from __future__ import annotations

import ssl
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from adapters.credentials import Tls, password, tls_problems, unreadable
from adapters.errors import SourceConfigError

VERSIONS = ("5", "3.1.1")


@dataclass(frozen=True)
class Broker:
    """A broker, and the client that connects to it.

    `version` is one of VERSIONS. `tls` without a `ca` trusts the authorities that the system trusts; None is no
    encryption. The broker knows a session by `client_id`. `keepalive`: after so many s without a word from the other
    side the connection counts as lost; `timeout`: how long an answer is waited for, in s.
    """

    host: str
    port: int = 1883
    version: str = "5"
    client_id: str = ""
    user: str | None = None
    password_file: Path | None = None
    password_env: str | None = None
    tls: Tls | None = None
    keepalive: float = 30.0
    timeout: float = 5.0

    @property
    def place(self) -> str:
        """Where it is, as a URL."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'mqtt' if self.tls is None else 'mqtts'}://{host}:{self.port}"

    def problems(self) -> Iterator[str]:
        """What is wrong with the files it names, or missing on this machine, one sentence each."""
        if find_spec("aiomqtt") is None:
            yield "MQTT needs the package aiomqtt; install it with pip install 'thermogate[mqtt]'"
        if self.password_file is not None and (reason := unreadable(self.password_file)):
            yield f"password_file: {self.password_file} cannot be read ({reason})"
        if self.tls is not None:
            yield from tls_problems(self.tls)

    def credentials(self) -> tuple[str | None, str | None]:
        """User and password, read anew; SourceConfigError if the password cannot be had."""
        return (None, None) if self.user is None else (self.user, password(self.password_file, self.password_env))

    def context(self) -> ssl.SSLContext | None:
        """What TLS needs, read anew; None without. SourceConfigError if a file cannot be used."""
        if self.tls is None:
            return None
        for problem in tls_problems(self.tls):
            raise SourceConfigError(problem)
        context = _Context(ssl.PROTOCOL_TLS_CLIENT)
        context.patience = self.timeout
        if self.tls.ca is None:
            context.load_default_certs()
        else:
            context.load_verify_locations(self.tls.ca)
        context.check_hostname = self.tls.verify_name
        if self.tls.certificate is not None and self.tls.private_key is not None:
            context.load_cert_chain(self.tls.certificate, self.tls.private_key, password="")
        return context


class _Context(ssl.SSLContext):
    """Shakes hands at once: the client library would wait long for an answer, and leave the socket open without."""

    patience = 5.0

    def wrap_socket(self, *arguments: Any, **settings: Any) -> ssl.SSLSocket:
        wrapped = super().wrap_socket(*arguments, **settings)
        try:
            wrapped.settimeout(self.patience)
            wrapped.do_handshake()
        except OSError:
            wrapped.close()
            raise
        return wrapped


def topic_problem(topic: str, pattern: bool = False) -> str | None:
    """What is wrong with a topic, or None; a `pattern` may have wildcards."""
    if not topic or "\0" in topic or len(topic.encode("utf-8", "surrogatepass")) > 65_535:
        return "is empty, too long or has a character that MQTT forbids"
    if any("\ud800" <= character <= "\udfff" for character in topic):
        return "is no UTF-8 text"
    if not pattern and any(wildcard in topic for wildcard in "+#"):
        return "has a wildcard (+ or #); name one topic for each channel"
    return None
