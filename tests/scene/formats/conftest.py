"""Other programs that read and write the formats."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from missing import unavailable
from pocketgs.scene.gaussians import Gaussians

PACKAGES = {
    "@playcanvas/splat-transform": "2.7.1",  # the last that runs on Node 18
    "@adobe/spz": "0.2.2",  # the reference implementation of .spz, compiled to WebAssembly
    "@gltf-transform/core": "4.5.1",
    "gltf-validator": "2.0.0-dev.3.10",
}


@pytest.fixture(scope="session")
def node_folder() -> Path:
    """A folder outside the repository with the packages installed, kept between test runs."""
    if not (shutil.which("node") and shutil.which("npm")):
        unavailable("no node and npm: install Node.js 18 or newer to compare with other programs")
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "pocketgs-tests"
    folder = cache / "-".join(PACKAGES.values())
    if not folder.is_dir():
        partial = folder.with_name(f".{os.getpid()}.partial")
        partial.mkdir(parents=True)
        (partial / "package.json").write_text(json.dumps({"private": True, "type": "module", "dependencies": PACKAGES}))
        command = ["npm", "install", "--no-audit", "--no-fund", "--prefix", str(partial)]
        result = subprocess.run(command, capture_output=True, text=True, timeout=600)
        if result.returncode:
            shutil.rmtree(partial)
            unavailable(f"npm cannot install the packages: {result.stderr[-500:]}")
        try:
            partial.rename(folder)
        except OSError:  # another session was faster
            shutil.rmtree(partial)
    return folder


@pytest.fixture
def run_node(node_folder: Path, tmp_path: Path) -> Callable[..., str]:
    """A function that runs JavaScript with the packages; it finds the arguments in `process.argv` from 2 on."""

    def run(program: str, *arguments: object) -> str:
        script = tmp_path / "program.mjs"
        script.write_text(program)
        (tmp_path / "node_modules").unlink(missing_ok=True)
        (tmp_path / "node_modules").symlink_to(node_folder / "node_modules")
        command = ["node", str(script), *map(str, arguments)]
        result = subprocess.run(command, capture_output=True, text=True, timeout=120)
        assert result.returncode == 0, result.stdout[-2000:] + result.stderr[-2000:]
        return result.stdout

    return run


@pytest.fixture
def splat_transform(node_folder: Path) -> Callable[..., None]:
    """A function that runs PlayCanvas' splat-transform with arguments."""
    program = node_folder / "node_modules" / "@playcanvas" / "splat-transform" / "bin" / "cli.mjs"

    def run(*arguments: object) -> None:
        command = ["node", str(program), "-w", "-q", *map(str, arguments)]
        result = subprocess.run(command, capture_output=True, text=True, timeout=120)
        assert result.returncode == 0, result.stdout[-2000:] + result.stderr[-2000:]

    return run


@pytest.fixture
def as_read_elsewhere(splat_transform: Callable[..., None], tmp_path: Path) -> Callable[[Path], Gaussians]:
    """A function that reads a file with splat-transform and returns the result."""

    def read(path: Path) -> Gaussians:
        plain = tmp_path / "elsewhere.ply"
        splat_transform(path, plain)
        return Gaussians.load(plain)

    return read
