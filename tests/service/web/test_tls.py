"""The certificate of the server: what is refused, and what becomes of a renewed one."""

import logging
import os
import ssl
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from support.certificates import Pair, make_pair

from service.errors import CertificateError
from service.web.server import tls
from service.web.server.tls import ServerCertificate


def loaded(pair: Pair) -> ServerCertificate:
    return ServerCertificate(pair.certificate, pair.private_key)


def test_only_modern_encryption(tmp_path: Path) -> None:
    certificate = loaded(make_pair(tmp_path))
    assert certificate.context.minimum_version == ssl.TLSVersion.TLSv1_2
    for cipher in certificate.context.get_ciphers():
        assert cipher["aead"], cipher["name"]
        assert cipher["protocol"] == "TLSv1.3" or cipher["name"].startswith("ECDHE-"), cipher["name"]
    assert abs(certificate.expires - datetime.now(UTC) - timedelta(days=90)) < timedelta(minutes=1)


def refusal(pair: Pair, client_ca: Path | None = None) -> str:
    with pytest.raises(CertificateError) as refused:
        ServerCertificate(pair.certificate, pair.private_key, client_ca)
    sentence = str(refused.value)
    assert "\n" not in sentence
    return sentence


def test_mistakes_in_one_sentence(tmp_path: Path) -> None:
    good, other = make_pair(tmp_path, "good"), make_pair(tmp_path, "other")
    locked = make_pair(tmp_path, "locked", password=b"hush")
    missing, empty = tmp_path / "missing.pem", tmp_path / "empty.pem"
    empty.write_text("")
    said = refusal(good._replace(certificate=missing))
    assert said.startswith("http.certificate: ")
    assert "missing.pem cannot be read (No such file or directory)" in said
    assert refusal(good._replace(private_key=missing)).startswith("http.private_key: ")
    assert "empty.pem is not what is needed here; give PEM" in refusal(good._replace(certificate=empty))
    assert "good.pem is not what is needed here" in refusal(good._replace(private_key=good.certificate))
    assert "other.key does not belong to the first certificate" in refusal(good._replace(private_key=other.private_key))
    assert "is encrypted, and there is nobody to ask" in refusal(locked)
    os.mkfifo(tmp_path / "pipe")
    for setting in ("certificate", "private_key"):
        assert "is a folder, a pipe or a device" in refusal(good._replace(**{setting: tmp_path / "pipe"}))
    for authority in (missing, empty, tmp_path / "pipe"):
        assert refusal(good, authority).startswith("http.client_ca: ")
    other.private_key.chmod(0o604)
    assert "every account of this machine" in refusal(other)
    other.private_key.chmod(0o640)
    loaded(other)


def test_a_renewed_certificate_is_noticed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    certificate = loaded(make_pair(tmp_path, days=60, kind="rsa"))
    before = certificate.context
    certificate.follow()
    assert certificate.context is before, "nothing has changed"
    make_pair(tmp_path, days=90, kind="ec")
    with caplog.at_level(logging.INFO):
        certificate.follow()
    assert "read again; it is good until" in caplog.text
    assert certificate.expires > datetime.now(UTC) + timedelta(days=89)
    assert certificate.context is not before, "the RSA certificate before it is served to nobody"


def test_a_mistaken_renewal_leaves_the_old_one(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    pair = make_pair(tmp_path)
    certificate = loaded(pair)
    context, expires = certificate.context, certificate.expires
    other = make_pair(tmp_path, "other", days=5)
    pair.certificate.write_bytes(other.certificate.read_bytes())
    for _ in range(3):
        certificate.follow()
    assert [record.levelname for record in caplog.records] == ["ERROR"], "said once"
    assert "until then the certificate as it was before is served" in caplog.text
    with pytest.raises(CertificateError):
        certificate.reload()
    assert (certificate.context, certificate.expires) == (context, expires)
    pair.private_key.write_bytes(other.private_key.read_bytes())
    certificate.follow()
    assert certificate.expires < expires


@pytest.mark.parametrize(("days", "words"), [(15, None), (13, "ends on"), (-1, "has ended on")])
def test_the_end_is_spoken_of_in_time_and_again_every_day(
    tmp_path: Path, days: float, words: str | None, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    certificate = loaded(make_pair(tmp_path, days=days))
    for reminder in (tls.REMIND_SECONDS, tls.REMIND_SECONDS, -1.0):
        monkeypatch.setattr(tls, "REMIND_SECONDS", reminder)
        certificate.follow()
    assert [words in record.getMessage() for record in caplog.records] == [True] * (2 if words else 0)
