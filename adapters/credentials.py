"""Passwords and certificates of a connection: where they are, and what is wrong with them there."""

from __future__ import annotations

import os
import ssl
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from adapters.errors import SourceConfigError


@dataclass(frozen=True)
class Tls:
    """Certificates, as files in PEM. `mutual`: with a certificate of our own, both sides show theirs."""

    ca: Path | None = None
    certificate: Path | None = None
    private_key: Path | None = None
    mutual: bool = True
    verify_name: bool = True


def unreadable(path: Path) -> str | None:
    """Why the file at `path` cannot be read, or None."""
    if path.exists() and not path.is_file():
        # A pipe would be waited for.
        return "it is no file"
    try:
        with path.open("rb"):
            return None
    except OSError as error:
        return (error.strerror or str(error)).lower()


def tls_problems(tls: Tls) -> Iterator[str]:
    """What is wrong with the files that `tls` names, one sentence each."""
    files = {"tls.ca": tls.ca, "tls.certificate": tls.certificate, "tls.private_key": tls.private_key}
    missing = {name: reason for name, path in files.items() if path is not None and (reason := unreadable(path))}
    yield from (f"{name}: {files[name]} cannot be read ({reason})" for name, reason in missing.items())
    if missing:
        return
    context = ssl.create_default_context()
    if tls.ca is not None:
        try:
            context.load_verify_locations(tls.ca)
        except ssl.SSLError:
            yield f"tls.ca: {tls.ca} holds no certificate in PEM; give the certificate of the authority"
    if tls.certificate is not None and tls.private_key is not None:
        try:
            # A key that is locked would otherwise be asked for at the terminal.
            context.load_cert_chain(tls.certificate, tls.private_key, password="")
        except (ssl.SSLError, ValueError):
            yield (
                f"tls.certificate: {tls.certificate} and tls.private_key {tls.private_key} are no certificate in PEM "
                "and the unlocked key that belongs to it"
            )


def password(file: Path | None, variable: str | None) -> str:
    """The password in `file` or else in the environment `variable`; SourceConfigError if it cannot be had."""
    if file is not None:
        try:
            return file.read_text(encoding="utf-8").strip("\r\n")
        except (OSError, UnicodeDecodeError):
            raise SourceConfigError(f"password_file: {file} cannot be read") from None
    name = variable or ""
    if name not in os.environ:
        raise SourceConfigError(f"password_env: the environment variable {name} is not set; set it and start again")
    return os.environ[name]
