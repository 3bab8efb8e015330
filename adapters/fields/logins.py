"""Who we are to others, as it is written in the configuration: user and password, and certificates."""

from __future__ import annotations

from typing import Self

from pydantic import BaseModel, model_validator

from adapters.fields.tables import TABLE
from adapters.fields.values import FilePath, Flag, Text


class LoginConfig(BaseModel):
    """A user, and where the password is."""

    model_config = TABLE

    user: Text | None = None
    password_file: FilePath | None = None
    password_env: Text | None = None

    @model_validator(mode="after")
    def _with_its_password(self) -> Self:
        passwords = [self.password_file, self.password_env]
        if (self.user is None) != (passwords.count(None) == 2) or None not in passwords:
            raise ValueError("user goes with the password's place: give user and one of password_file and password_env")
        return self


class CertificatesConfig(BaseModel):
    """Certificates, as files in PEM."""

    model_config = TABLE

    ca: FilePath | None = None
    certificate: FilePath | None = None
    private_key: FilePath | None = None
    verify_name: Flag = True

    @model_validator(mode="after")
    def _paired(self) -> Self:
        if (self.certificate is None) != (self.private_key is None):
            raise ValueError("certificate and private_key belong together; give both, or neither")
        return self
