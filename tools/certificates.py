"""Find trusted certificates for https downloads if Python alone finds none.

Standard library only: it runs before anything is installed.
"""

from __future__ import annotations

import os
import shutil
import ssl
import subprocess
import tarfile
import tempfile
from pathlib import Path

# Paths of the system's bundle on Linux distributions and macOS.
BUNDLES = (
    "/etc/ssl/certs/ca-certificates.crt",
    "/etc/pki/tls/certs/ca-bundle.crt",
    "/etc/ssl/ca-bundle.pem",
    "/etc/ssl/cert.pem",
)


def certificate_bundle(fallback: Path) -> str | None:
    """Path of a file of trusted certificates, or None to leave the choice to Python.

    In order: PIP_CERT or SSL_CERT_FILE, the system's bundle, and on Debian or Ubuntu without one the bundle of the
    `ca-certificates` package. apt checks the package's signature, as for an installation; here it is only unpacked, to
    `fallback`, and the system is not changed.
    """
    named = (os.environ.get("PIP_CERT"), os.environ.get("SSL_CERT_FILE"), ssl.get_default_verify_paths().cafile)
    for path in (*named, *BUNDLES, str(fallback)):
        if path and os.path.isfile(path):
            return path
    folder = ssl.get_default_verify_paths().capath
    if (folder and os.listdir(folder)) or not shutil.which("apt-get"):
        return None
    return _unpack_debian_bundle(fallback)


def _unpack_debian_bundle(target: Path) -> str | None:
    print("No certificates on this system: reading those of the ca-certificates package", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        apt = ["apt-get", "-qq", f"-oDir::State::Lists={folder}", f"-oDir::Cache={folder}", "-oAcquire::Languages=none"]
        try:
            # Left to itself apt would switch to a user who may not read the temporary folder.
            for action in (["update"], ["download", "ca-certificates"]):
                command = [*apt, "-oAPT::Sandbox::User=", *action]
                subprocess.run(command, cwd=folder, stderr=subprocess.DEVNULL, check=True)
            package = next(Path(folder).glob("ca-certificates_*.deb"))
            with open(Path(folder, "contents.tar"), "wb") as contents:
                subprocess.run(["dpkg-deb", "--fsys-tarfile", package], stdout=contents, check=True)
        except (OSError, subprocess.CalledProcessError, StopIteration):
            return None
        with tarfile.open(Path(folder, "contents.tar")) as archive:
            authorities = [member for member in archive if member.name.startswith("./usr/share/ca-certificates/")]
            files = [archive.extractfile(member) for member in authorities if member.isfile()]
            target.write_bytes(b"\n".join(file.read() for file in files if file is not None))
    return str(target)
