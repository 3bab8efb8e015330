"""Certificates of an OPC UA channel: who we are, and whom we trust."""

from pathlib import Path
from typing import NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey
from cryptography.hazmat.primitives.serialization import load_der_private_key, load_pem_private_key

from adapters.errors import SourceConfigError
from adapters.fields.logins import unreadable


class Identity(NamedTuple):
    """Our certificate with its key, the server's, and the URI by which ours names this application."""

    certificate: x509.Certificate
    key: RSAPrivateKey
    server: x509.Certificate
    uri: str


def identity(certificate: Path, private_key: Path, server_certificate: Path) -> Identity:
    """What is in the three files. SourceConfigError with one sentence about a file that cannot be used."""
    own, server = _certificate("certificate", certificate), _certificate("server_certificate", server_certificate)
    content = _content("private_key", private_key)
    try:
        key = (load_pem_private_key if _is_pem(content) else load_der_private_key)(content, None)
    except (ValueError, TypeError):
        key = None
    if not isinstance(key, RSAPrivateKey) or key.public_key() != own.public_key():
        raise SourceConfigError(
            f"security.private_key: {private_key} is not the unlocked RSA key that belongs to {certificate}"
        )
    try:
        names = own.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        uri = names.get_values_for_type(x509.UniformResourceIdentifier)[0]
    except (x509.ExtensionNotFound, IndexError):
        raise SourceConfigError(
            f"security.certificate: {certificate} names no application; make one with a URI such as "
            '"urn:thermogate" as subject alternative name'
        ) from None
    return Identity(own, key, server, uri)


def _certificate(name: str, path: Path) -> x509.Certificate:
    content = _content(name, path)
    try:
        return (x509.load_pem_x509_certificate if _is_pem(content) else x509.load_der_x509_certificate)(content)
    except ValueError:
        raise SourceConfigError(f"security.{name}: {path} holds no certificate in PEM or DER") from None


def _content(name: str, path: Path) -> bytes:
    if reason := unreadable(path):
        raise SourceConfigError(f"security.{name}: {path} cannot be read ({reason})")
    return path.read_bytes()


def _is_pem(content: bytes) -> bool:
    return content.lstrip().startswith(b"-----BEGIN")
