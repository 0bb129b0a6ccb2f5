"""Install what tests need beyond Python packages: a software GPU driver, a browser, Node.js.

    python3 tools/system_packages.py

On Debian and Ubuntu, if run by root, it installs what is missing. Elsewhere it names it in one line; the tests that
need it are then skipped, unless CI is set.
"""

from __future__ import annotations

import ctypes.util
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

BROWSERS = ("chromium", "google-chrome", "chromium-browser")
DRIVER_FOLDERS = (Path("/usr/share/vulkan/icd.d"), Path("/usr/local/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d"))
CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")


@dataclass(frozen=True)
class Need:
    """A dependency of the tests.

    Attributes:
        package: Debian package that contains it.
        what: description.
        is_there: checks for it.
    """

    package: str
    what: str
    is_there: Callable[[], bool]


def any_program(*names: str) -> Callable[[], bool]:
    """A function that returns whether one of these programs is installed."""
    return lambda: any(map(shutil.which, names))


def has_driver() -> bool:
    """Whether Vulkan has a driver."""
    return any(any(folder.glob("*.json")) for folder in DRIVER_FOLDERS)


NEEDS = (
    Need("libvulkan1", "Vulkan", lambda: ctypes.util.find_library("vulkan") is not None),
    Need("mesa-vulkan-drivers", "a driver for Vulkan, which may be one in software", has_driver),
    Need("chromium", "a browser", any_program(*BROWSERS)),
    Need("nodejs", "Node.js", any_program("node")),
    Need("npm", "npm", any_program("npm")),
)


def main() -> int:
    """Install what is missing, or name it; the exit status is 1 if continuous integration cannot continue."""
    if not sys.platform.startswith("linux"):
        return 0
    missing = [need for need in NEEDS if not need.is_there()]
    if missing and may_install():
        install([need.package for need in missing])
        missing = [need for need in missing if not need.is_there()]
    if missing:
        print(f"system packages: {left_out(missing)}", flush=True)
    return 1 if missing and os.environ.get("CI") else 0


def may_install() -> bool:
    """Whether this is Debian or Ubuntu, run by root."""
    return shutil.which("apt-get") is not None and os.geteuid() == 0


def install(packages: list[str]) -> None:
    """Install packages one by one, so that a missing one does not block the others."""
    if not CERTIFICATES.exists():
        packages = ["ca-certificates", *packages]
    print(f"Installing system packages for tests: {' '.join(packages)}", flush=True)
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    commands = [["update", "-q"], *(["install", "-q", "-y", "--no-install-recommends", name] for name in packages)]
    for command in commands:
        subprocess.run(["apt-get", *command], env=environment, stdin=subprocess.DEVNULL)


def left_out(missing: list[Need]) -> str:
    """One line about what is missing, and how to get it."""
    things = ", ".join(need.what for need in missing)
    command = f"apt-get install --no-install-recommends {' '.join(need.package for need in missing)}"
    return f"Not there: {things}. Tests that need it are left out; on Debian and Ubuntu, `sudo {command}` brings it."


if __name__ == "__main__":
    sys.exit(main())
