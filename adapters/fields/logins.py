"""Who we are to others: user and password, and certificates, and what is wrong with the files that hold them."""

import os
import ssl
from collections.abc import Iterator
from pathlib import Path
from typing import Self

from pydantic import Field, model_validator

from adapters.errors import SourceConfigError
from adapters.fields.tables import Table
from adapters.fields.values import FilePath, Flag, Text


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


class LoginConfig(Table):
    """A user, and where the password is."""

    user: Text | None = Field(default=None, description="user name")
    password_file: FilePath | None = Field(default=None, description="file with nothing but the password")
    password_env: Text | None = Field(default=None, description="environment variable with the password")

    @model_validator(mode="after")
    def _with_its_password(self) -> Self:
        passwords = [self.password_file, self.password_env]
        if (self.user is None) != (passwords.count(None) == 2) or None not in passwords:
            raise ValueError("user goes with the password's place: give user and one of password_file and password_env")
        return self

    def credentials(self) -> tuple[str | None, str | None]:
        """User and password, read anew; None without a user. SourceConfigError if the password cannot be had."""
        return (None, None) if self.user is None else (self.user, password(self.password_file, self.password_env))

    def problems(self) -> Iterator[str]:
        """What is wrong with the files that it names, one sentence each."""
        if self.password_file is not None and (reason := unreadable(self.password_file)):
            yield f"password_file: {self.password_file} cannot be read ({reason})"


class CertificatesConfig(Table):
    """Certificates, as files in PEM."""

    ca: FilePath | None = Field(default=None, description="authority of the other side, PEM; none: the well-known ones")
    certificate: FilePath | None = Field(default=None, description="own certificate, PEM")
    private_key: FilePath | None = Field(default=None, description="its key, PEM, without a password")
    verify_name: Flag = Field(default=True, description="the other side's certificate must name the host")

    @model_validator(mode="after")
    def _paired(self) -> Self:
        if (self.certificate is None) != (self.private_key is None):
            raise ValueError("certificate and private_key belong together; give both, or neither")
        return self

    def problems(self) -> Iterator[str]:
        files = {"tls.ca": self.ca, "tls.certificate": self.certificate, "tls.private_key": self.private_key}
        missing = {name: reason for name, path in files.items() if path is not None and (reason := unreadable(path))}
        yield from (f"{name}: {files[name]} cannot be read ({reason})" for name, reason in missing.items())
        if missing:
            return
        context = ssl.create_default_context()
        if self.ca is not None:
            try:
                context.load_verify_locations(self.ca)
            except ssl.SSLError:
                yield f"tls.ca: {self.ca} holds no certificate in PEM; give the certificate of the authority"
        if self.certificate is not None and self.private_key is not None:
            try:
                # A key that is locked would otherwise be asked for at the terminal.
                context.load_cert_chain(self.certificate, self.private_key, password="")
            except (ssl.SSLError, ValueError):
                yield (
                    f"tls.certificate: {self.certificate} and tls.private_key {self.private_key} are no certificate in "
                    "PEM and the unlocked key that belongs to it"
                )
