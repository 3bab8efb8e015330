"""Certificates for tests of TLS, made on the spot."""

import ipaddress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.x509.oid import NameOID


class Pair(NamedTuple):
    """Files of a certificate and its key, with both as objects."""

    certificate: Path
    private_key: Path
    issued: x509.Certificate
    key: ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey


def make_pair(
    folder: Path,
    name: str = "server",
    *,
    days: float = 90,
    signer: Pair | None = None,
    kind: str = "ec",
    password: bytes | None = None,
    uri: str | None = None,
) -> Pair:
    """NAME.pem and NAME.key for localhost, 127.0.0.1 and `uri`, good for `days` from now, signed by `signer` or
    itself."""
    key = ec.generate_private_key(ec.SECP256R1()) if kind == "ec" else rsa.generate_private_key(65537, 2048)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now = datetime.now(UTC)
    names = [x509.DNSName("localhost"), x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]
    names += [x509.UniformResourceIdentifier(uri)] if uri else []
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(signer.issued.subject if signer else subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(min(now, now + timedelta(days=days)) - timedelta(days=1))
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.BasicConstraints(ca=signer is None, path_length=None), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
    )
    issued = builder.sign(signer.key if signer else key, hashes.SHA256())
    certificate, private_key = folder / f"{name}.pem", folder / f"{name}.key"
    certificate.write_bytes(issued.public_bytes(serialization.Encoding.PEM))
    encryption = serialization.BestAvailableEncryption(password) if password else serialization.NoEncryption()
    form = serialization.PrivateFormat.PKCS8
    private_key.write_bytes(key.private_bytes(serialization.Encoding.PEM, form, encryption))
    private_key.chmod(0o600)
    return Pair(certificate, private_key, issued, key)
