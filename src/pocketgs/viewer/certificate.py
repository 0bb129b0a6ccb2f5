"""A self-signed certificate for this machine.

Browsers allow WebGPU only on pages from https or from the local machine. No authority certifies addresses in a home
network, so a phone's browser asks its user before it accepts the certificate. The certificate is cached, so that the
question comes once.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from ipaddress import ip_address
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing

FILE = "viewer.pem"
VALIDITY = timedelta(days=397)
"""Apple's systems reject certificates that are valid for more than 398 days."""

MIN_VALIDITY = timedelta(days=2)
CLOCK_SKEW = timedelta(days=1)


def cache_folder() -> Path:
    """The user's cache folder.

    Raises:
        PocketGSError: the user has no home folder.
    """
    try:
        if sys.platform == "win32":
            base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
        elif sys.platform == "darwin":
            base = Path.home() / "Library" / "Caches"
        else:
            base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError as error:
        raise PocketGSError(f"no folder for the page's certificate ({error}), expected HOME to name one") from error
    return base / "pocketgs"


def certificate_file(hosts: Sequence[str], folder: Path) -> Path:
    """A PEM file with a private key and a certificate for some hosts; created if no existing one covers them all.

    Args:
        hosts: names and IP addresses.
        folder: where it is kept; created if needed.

    Raises:
        PocketGSError: it cannot be written.
    """
    path = folder / FILE
    if not _is_good_for(path, hosts):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise PocketGSError(f"{folder}: cannot be made ({error.strerror or error})") from error
        with replacing(path) as partial:
            partial.touch(mode=0o600)  # before the key is written
            partial.write_bytes(_make(hosts, datetime.now(timezone.utc)))
    return path


def fingerprint(path: Path) -> str:
    """SHA-256 of the certificate in a PEM file, as browsers show it."""
    return x509.load_pem_x509_certificate(path.read_bytes()).fingerprint(hashes.SHA256()).hex(":").upper()


def _is_good_for(path: Path, hosts: Sequence[str]) -> bool:
    try:
        content = path.read_bytes()
        certificate = x509.load_pem_x509_certificate(content)
        key = serialization.load_pem_private_key(content, password=None)
        named = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        left = certificate.not_valid_after_utc - datetime.now(timezone.utc)
    except (OSError, ValueError, TypeError, x509.ExtensionNotFound, UnsupportedAlgorithm):
        return False
    is_pair = key.public_key() == certificate.public_key()
    return is_pair and left >= MIN_VALIDITY and all(_general_name(host) in named for host in hosts)


def _make(hosts: Sequence[str], now: datetime) -> bytes:
    key = ec.generate_private_key(ec.SECP256R1())
    public = key.public_key()
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "PocketGS on this machine")])
    extensions: list[tuple[x509.ExtensionType, bool]] = [
        (x509.SubjectAlternativeName([_general_name(host) for host in hosts]), False),
        # It is trusted for these hosts only: it cannot sign other certificates.
        (x509.BasicConstraints(ca=False, path_length=None), True),
        (x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), False),
        (x509.SubjectKeyIdentifier.from_public_key(public), False),
        (x509.AuthorityKeyIdentifier.from_issuer_public_key(public), False),
    ]
    builder = x509.CertificateBuilder(
        issuer_name=name,
        subject_name=name,
        public_key=public,
        serial_number=x509.random_serial_number(),
        not_valid_before=now - CLOCK_SKEW,
        not_valid_after=now - CLOCK_SKEW + VALIDITY,
    )
    for extension, critical in extensions:
        builder = builder.add_extension(extension, critical)
    certificate = builder.sign(key, hashes.SHA256())
    plain = serialization.NoEncryption()
    private = key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, plain)
    return private + certificate.public_bytes(serialization.Encoding.PEM)


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        return x509.DNSName(host)
