"""The certificate that this machine makes for itself."""

from __future__ import annotations

import ssl
import stat
import sys
from datetime import datetime, timedelta, timezone
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from pocketgs import PocketGSError
from pocketgs.viewer import certificate
from pocketgs.viewer.address import host_names, lan_addresses, qr_code
from pocketgs.viewer.certificate import cache_folder, certificate_file, fingerprint
from pocketgs.viewer.content import Content
from pocketgs.viewer.server import serving
from viewer.client import fetch

HOSTS = ["127.0.0.1", "localhost", "192.168.7.9", "toys.local"]


@pytest.fixture
def trust(tmp_path: Path) -> ssl.SSLContext:
    """A context that trusts only the certificate for these hosts in the test's folder."""
    names = ["127.0.0.1", "localhost", *lan_addresses(), *host_names()]
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.verify_flags |= ssl.VERIFY_X509_STRICT
    context.load_verify_locations(certificate_file(names, tmp_path))
    return context


def test_page_over_the_network(trust: ssl.SSLContext, tmp_path: Path) -> None:
    with serving(Content("toys"), network=True, certificates=tmp_path) as page:
        assert page.url.startswith("https://127.0.0.1:")
        assert page.fingerprint == fingerprint(tmp_path / "viewer.pem")
        assert fetch(page.url, "viewer.json", trust=trust).json["title"] == "toys"
        assert fetch(page.url, "viewer.json", trust=trust, headers={"Host": "evil.example"}).status == 403
        port = urlsplit(page.url).port
        assert fetch(page.url.replace("127.0.0.1", "localhost"), "viewer.json", trust=trust).status == 200
        for address in lan_addresses():
            assert fetch(page.url.replace("127.0.0.1", address), "viewer.json", trust=trust).status == 200
        if page.network_url:
            assert page.network_url.startswith(f"https://{lan_addresses()[0]}:{port}/")
        with pytest.raises(ssl.SSLCertVerificationError):
            fetch(page.url, "viewer.json", trust=ssl.create_default_context())
        with pytest.raises((ConnectionError, OSError)):
            fetch(page.url.replace("https", "http"), "viewer.json")


def test_it_is_kept(tmp_path: Path) -> None:
    path = certificate_file(HOSTS, tmp_path / "deep" / "er")
    content = path.read_bytes()
    assert certificate_file(HOSTS[:2], path.parent).read_bytes() == content
    assert certificate_file([*HOSTS, "10.0.0.1"], path.parent).read_bytes() != content
    assert [item.name for item in path.parent.iterdir()] == ["viewer.pem"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such permissions")
def test_nobody_else_can_read_the_key(tmp_path: Path) -> None:
    assert stat.S_IMODE(certificate_file(HOSTS, tmp_path).stat().st_mode) == 0o600


@pytest.mark.parametrize("broken", [b"", b"hello", b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"])
def test_broken_one_is_replaced(tmp_path: Path, broken: bytes) -> None:
    whole = certificate_file(HOSTS, tmp_path).read_bytes()
    (tmp_path / "viewer.pem").write_bytes(broken)
    assert fingerprint(certificate_file(HOSTS, tmp_path))
    (tmp_path / "viewer.pem").write_bytes(whole[: len(whole) // 2])
    assert fingerprint(certificate_file(HOSTS, tmp_path))


@pytest.mark.parametrize("days", [396, 500])
def test_one_that_runs_out_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, days: int) -> None:
    made = datetime.now(timezone.utc) - timedelta(days=days)
    old = certificate._make(HOSTS, made)
    (tmp_path / "viewer.pem").write_bytes(old)
    assert certificate_file(HOSTS, tmp_path).read_bytes() != old


def test_folder_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(PocketGSError, match="file"):
        certificate_file(HOSTS, tmp_path / "file" / "below")


def test_cache_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "pocketgs"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "pocketgs"


def test_qr_code_holds_the_address() -> None:
    import cv2
    import numpy as np

    url = "https://192.168.178.123:45678/AbCdEfGhIjKlMnOpQrStUv/"
    # A character stands for two pixels, one above the other.
    halves = {"█": (255, 255), "▀": (255, 0), "▄": (0, 255), " ": (0, 0), "\xa0": (0, 0)}
    rows = [np.array([halves[character] for character in line]).T for line in qr_code(url).splitlines()]
    picture = np.kron(np.concatenate(rows), np.ones((8, 8))).astype(np.uint8)
    found, *_ = cv2.QRCodeDetector().detectAndDecode(np.pad(picture, 32, constant_values=255))
    assert found == url
