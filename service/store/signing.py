"""Signatures of backups: Ed25519, with keys in PEM files as `openssl genpkey -algorithm ed25519` makes them."""

import base64
from collections.abc import Callable
from pathlib import Path

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import load_pem_private_key, load_pem_public_key

from service.errors import BackupError


def signature(statement: bytes, key_file: Path) -> str:
    """The signature of `statement` with the private key in a file, base64. Raises BackupError."""
    key = _loaded(key_file, lambda content: load_pem_private_key(content, None))
    if not isinstance(key, Ed25519PrivateKey):
        raise _no_key(key_file, "private")
    return base64.b64encode(key.sign(statement)).decode()


def public_key(key_file: Path) -> Ed25519PublicKey:
    """The public key in a file. Raises BackupError."""
    key = _loaded(key_file, load_pem_public_key)
    if not isinstance(key, Ed25519PublicKey):
        raise _no_key(key_file, "public")
    return key


def is_signed(statement: bytes, signed: str, key: Ed25519PublicKey) -> bool:
    """Whether `signed` (base64) is the signature of `statement` that belongs to the public `key`."""
    try:
        key.verify(base64.b64decode(signed, validate=True), statement)
    except (InvalidSignature, ValueError):
        return False
    return True


def _loaded(file: Path, load: Callable[[bytes], object]) -> object:
    try:
        return load(file.read_bytes())
    except OSError as error:
        raise BackupError(f"the key {file} cannot be read ({error.strerror}); check path and rights") from None
    except (ValueError, TypeError, UnsupportedAlgorithm):
        return None


def _no_key(file: Path, part: str) -> BackupError:
    remedy = "make one as docs/operations.md says"
    return BackupError(f"{file} has no {part} key of Ed25519 in PEM without a password; {remedy}")
