"""Create the virtual environment in .venv that the Makefile's targets use.

    python3 tools/bootstrap.py [EXTRA ...]

It needs only Python: no pip, no ensurepip (which Debian packages separately, as python3-venv), no compiler. If nothing
has changed since the last run it returns at once. PIP_INDEX_URL, PIP_CERT and pip's other variables are respected.
"""

from __future__ import annotations

import hashlib
import html
import importlib.util
import json
import os
import re
import shutil
import ssl
import subprocess
import sys
import urllib.error
import urllib.parse
import urllib.request
import venv
from pathlib import Path
from typing import Any

from certificates import certificate_bundle

ROOT = Path(__file__).resolve().parent.parent
ENVIRONMENT = ROOT / ".venv"
PYTHON = ENVIRONMENT / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
STAMP = ENVIRONMENT / "bootstrap.json"
OLDEST_PYTHON = (3, 10)

# The version of pip to install if Python has none. Its hash is stated here rather than read from the index.
PIP_WHEEL = "pip-26.3-py3-none-any.whl"
PIP_SHA256 = "f3b60b20ffaadd4415ed7957212a38ac63fa4c5fa375bd0f4a797777940fad13"
WITH_PYTORCH = {"gsplat", "lpips", "torch"}
"""Extras that need PyTorch, which on Linux brings CUDA's libraries."""

DEFAULT_INDEX = "https://pypi.org/simple"


class BootstrapError(Exception):
    """The environment cannot be created; the message says why and what to do."""


def main(extras: list[str]) -> None:
    """Bring the environment up to date with pyproject.toml and the requested extras."""
    if sys.version_info < OLDEST_PYTHON:
        raise BootstrapError(f"Python {sys.version.split()[0]} found, expected 3.10 or newer")
    wanted = sorted(set(extras) | installed_extras())
    key = stamp_key(ROOT / "pyproject.toml")
    if is_current(STAMP, key, extras) and PYTHON.exists():
        return
    print(f"Setting up {ENVIRONMENT.name}: the first time this downloads {download_size(wanted)}", flush=True)
    if not PYTHON.exists():
        create_environment(ENVIRONMENT)
    bundle = certificate_bundle(ENVIRONMENT / "certificates.pem")
    if not has_pip():
        install_pip(ENVIRONMENT / PIP_WHEEL, bundle)
    project = f"{ROOT}[{','.join(wanted)}]" if wanted else str(ROOT)
    run_pip([PYTHON, "-m", "pip"], ["install", "--editable", project], bundle)
    STAMP.write_text(json.dumps({"key": key, "extras": wanted}), encoding="utf-8")


def download_size(extras: list[str]) -> str:
    """How much is downloaded, in words."""
    if WITH_PYTORCH.isdisjoint(extras):
        return "about 280 MB of packages"
    return "several gigabytes of packages, most of them PyTorch's, which take 7 GB on the disk"


def stamp_key(project_file: Path) -> str:
    """Hash of everything that determines the environment, except the extras."""
    recipe = project_file.read_bytes() + f"{sys.version_info[:2]} {project_file}".encode()
    return hashlib.sha256(recipe).hexdigest()


def is_current(stamp: Path, key: str, extras: list[str]) -> bool:
    """Whether the stamp was written for the same key and at least these extras."""
    recorded = read_stamp(stamp)
    return recorded.get("key") == key and set(extras) <= set(recorded.get("extras", []))


def installed_extras() -> set[str]:
    """Extras that earlier runs installed: they are kept, so that `make demo` does not undo `make test`."""
    return set(read_stamp(STAMP).get("extras", []))


def read_stamp(stamp: Path) -> dict[str, Any]:
    """Read what the last run recorded; empty if none finished."""
    try:
        return json.loads(stamp.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def create_environment(folder: Path) -> None:
    """Make an environment, with pip where Python can provide it."""
    with_pip = importlib.util.find_spec("ensurepip") is not None
    try:
        venv.EnvBuilder(with_pip=with_pip, clear=True, symlinks=os.name != "nt").create(folder)
    except (OSError, subprocess.CalledProcessError) as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise BootstrapError(f"cannot make an environment in {folder}: {error}") from error


def has_pip() -> bool:
    """Whether the environment has pip."""
    return subprocess.run([PYTHON, "-c", "import pip"], stderr=subprocess.DEVNULL).returncode == 0


def install_pip(wheel: Path, bundle: str | None) -> None:
    """Install pip into the environment: its wheel can be run directly."""
    index = os.environ.get("PIP_INDEX_URL", DEFAULT_INDEX).rstrip("/") + "/pip/"
    page = download(index, bundle).decode("utf-8", errors="replace")
    contents = download(wheel_address(page, index), bundle)
    found = hashlib.sha256(contents).hexdigest()
    if found != PIP_SHA256:
        raise BootstrapError(f"{PIP_WHEEL} from {index} has SHA-256 {found}, expected {PIP_SHA256}")
    wheel.write_bytes(contents)
    run_pip([PYTHON, wheel / "pip"], ["install", "--quiet", "--no-index", wheel], bundle)
    wheel.unlink()


def wheel_address(page: str, index: str) -> str:
    """Address of pip's wheel on the index's page for pip (PEP 503)."""
    link = re.search(rf"""href=["']([^"'#]*{re.escape(PIP_WHEEL)})""", page)
    if link is None:
        raise BootstrapError(f"{index} does not list {PIP_WHEEL}; installing python3-venv avoids the need for it")
    return urllib.parse.urljoin(index, html.unescape(link.group(1)))


def download(address: str, bundle: str | None) -> bytes:
    """Contents at an address."""
    request = urllib.request.Request(address, headers={"Accept": "text/html, */*"})
    try:
        with urllib.request.urlopen(request, timeout=60, context=ssl.create_default_context(cafile=bundle)) as response:
            return response.read()
    except (OSError, ValueError) as error:
        raise BootstrapError(download_failure(address, error)) from error


def download_failure(address: str, error: Exception) -> str:
    """Describe a failure and its remedy in one line."""
    if isinstance(error, urllib.error.HTTPError):
        return f"{address}: the server answered {error.code} {error.reason}"
    reason = error.reason if isinstance(error, urllib.error.URLError) else error
    if isinstance(reason, ssl.SSLCertVerificationError):
        trust = "the system's certificates do not cover it (on Debian and Ubuntu: apt install ca-certificates"
        return f"{address}: {trust}; or name a bundle in SSL_CERT_FILE)"
    return f"{address}: cannot download ({reason}); is there a network connection?"


def run_pip(pip: list[str | Path], arguments: list[str | Path], bundle: str | None) -> None:
    """Run pip with the same certificates as our own downloads."""
    variables = {"PIP_DISABLE_PIP_VERSION_CHECK": "1", **({"PIP_CERT": bundle} if bundle else {})}
    if subprocess.run([*pip, *arguments], env={**os.environ, **variables}).returncode:
        raise BootstrapError("pip failed to install the packages: its messages above say why")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except BootstrapError as error:
        sys.exit(f"bootstrap: {error}")
    except KeyboardInterrupt:
        sys.exit("bootstrap: interrupted; run it again to continue")
