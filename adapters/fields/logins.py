"""Who we are to others, as it is written in the configuration: user and password, and certificates."""

from __future__ import annotations

from typing import Self

from pydantic import BaseModel, Field, model_validator

from adapters.fields.tables import TABLE
from adapters.fields.values import FilePath, Flag, Text


class LoginConfig(BaseModel):
    """A user, and where the password is."""

    model_config = TABLE

    user: Text | None = Field(default=None, description="user name")
    password_file: FilePath | None = Field(default=None, description="file with nothing but the password")
    password_env: Text | None = Field(default=None, description="environment variable with the password")

    @model_validator(mode="after")
    def _with_its_password(self) -> Self:
        passwords = [self.password_file, self.password_env]
        if (self.user is None) != (passwords.count(None) == 2) or None not in passwords:
            raise ValueError("user goes with the password's place: give user and one of password_file and password_env")
        return self


class CertificatesConfig(BaseModel):
    """Certificates, as files in PEM."""

    model_config = TABLE

    ca: FilePath | None = Field(default=None, description="authority of the other side, PEM; none: the well-known ones")
    certificate: FilePath | None = Field(default=None, description="own certificate, PEM")
    private_key: FilePath | None = Field(default=None, description="its key, PEM, without a password")
    verify_name: Flag = Field(default=True, description="the other side's certificate must name the host")

    @model_validator(mode="after")
    def _paired(self) -> Self:
        if (self.certificate is None) != (self.private_key is None):
            raise ValueError("certificate and private_key belong together; give both, or neither")
        return self
