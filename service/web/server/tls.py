"""The certificate that REST is served with: loaded, checked, followed when it is renewed."""

import logging
import math
import ssl
import stat
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import TypeVar

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from adapters.fields.times import written_day
from service.config.http import HttpConfig
from service.errors import CertificateError
from service.web.server.followed import FollowedFiles

WARN_SECONDS = 14 * 86400.0
"""How long before its end a certificate is spoken of in the log."""
REMIND_SECONDS = 86400.0
CIPHERS = "ECDHE+AESGCM:ECDHE+CHACHA20"
"""Of TLS 1.2: forward secrecy and authenticated encryption only. TLS 1.3 has nothing else."""
_NO_PAIR = ("KEY_VALUES_MISMATCH", "KEY_TYPE_MISMATCH", "NO_CERTIFICATE_ASSIGNED")

Content = TypeVar("Content")

_log = logging.getLogger(__name__)


class ServerCertificate:
    """Certificate and key of the server: `context` for the next handshake, `expires` for when the certificate ends."""

    context: ssl.SSLContext
    expires: datetime

    def __init__(self, certificate: Path, private_key: Path, client_ca: Path | None = None) -> None:
        """Loads the files; CertificateError if they cannot be used."""
        self._certificate = certificate
        self._private_key = private_key
        self._client_ca = client_ca
        self._reminded = -math.inf
        self._files = FollowedFiles(*(path for path in (certificate, private_key, client_ca) if path is not None))
        self.reload()

    def reload(self) -> None:
        """Use what is in the files now, for new connections. CertificateError leaves everything as it was."""
        self._files.look()
        chain = _read("certificate", self._certificate, x509.load_pem_x509_certificates)
        # A context of its own: one that held an RSA certificate would go on serving it beside its ECDSA successor.
        self.context = _context(self._certificate, self._private_key, self._client_ca)
        self.expires = chain[0].not_valid_after_utc
        self._files.complaint = ""
        self._reminded = -math.inf

    def follow(self) -> None:
        """Reload if a file has changed, and remind in the log of a certificate that comes to its end."""
        if self._files.follow(self.reload, "the certificate as it was before is served"):
            _log.info("%s was read again; it is good until %s", self._certificate, written_day(self.expires))
        left = self.expires.timestamp() - time.time()
        if left < WARN_SECONDS and time.monotonic() - self._reminded > REMIND_SECONDS:
            self._reminded = time.monotonic()
            verb = "ends" if left > 0 else "has ended"
            _log.warning(
                "the certificate %s %s on %s; renew it, a new one is read without a restart",
                self._certificate,
                verb,
                written_day(self.expires),
            )


def server_certificate(config: HttpConfig) -> ServerCertificate | None:
    """What `config` asks for; None without encryption. CertificateError if the files cannot be used."""
    if config.certificate is None or config.private_key is None:
        return None
    return ServerCertificate(config.certificate, config.private_key, config.client_ca)


def _context(certificate: Path, private_key: Path, client_ca: Path | None) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.set_ciphers(CIPHERS)
    context.options |= ssl.OP_NO_RENEGOTIATION | ssl.OP_CIPHER_SERVER_PREFERENCE
    _read("private_key", private_key, lambda content: load_pem_private_key(content, password=None))
    if private_key.stat().st_mode & stat.S_IRWXO:
        raise CertificateError(
            f"http.private_key: every account of this machine can get at {private_key}; say: chmod o= {private_key}"
        )
    try:
        context.load_cert_chain(certificate, private_key)
    except OSError as error:
        if getattr(error, "reason", None) in _NO_PAIR:
            raise CertificateError(
                f"http.private_key: {private_key} does not belong to the first certificate in {certificate}; give the "
                "pair, the server's own certificate before those that signed it"
            ) from None
        reason = error.reason if isinstance(error, ssl.SSLError) else error.strerror
        raise CertificateError(
            f"http.certificate: {certificate} cannot be served ({reason}); make another one"
        ) from None
    if client_ca is not None:
        _read("client_ca", client_ca, x509.load_pem_x509_certificates)
        context.load_verify_locations(cafile=client_ca)
        context.verify_mode = ssl.CERT_REQUIRED
    return context


def _read(setting: str, path: Path, parse: Callable[[bytes], Content]) -> Content:
    try:
        # The event loop would wait for a pipe for ever.
        if stat.S_ISREG(path.stat().st_mode):
            return parse(path.read_bytes())
        sentence = "is a folder, a pipe or a device; give a file"
    except OSError as error:
        sentence = f"cannot be read ({error.strerror}); give a file that the daemon's account can read"
    except TypeError:
        # What cryptography raises for an encrypted key without password.
        sentence = "is encrypted, and there is nobody to ask for the password; decrypt it with openssl pkey -in"
    except (ValueError, UnsupportedAlgorithm):
        sentence = "is not what is needed here; give PEM, which begins with a line -----BEGIN ...-----"
    raise CertificateError(f"http.{setting}: {path} {sentence}")
