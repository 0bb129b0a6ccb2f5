"""The command line in this process and in others, and a result to work on."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

from pocketgs.capture.synthetic import write_demo
from pocketgs.cli import main
from pocketgs.cli.commands import demo


@dataclass(frozen=True)
class Outcome:
    """Outcome of a command."""

    status: int
    output: str
    errors: str


@pytest.fixture
def pocketgs(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """A function that runs `pocketgs` with arguments in this process."""

    def call(*arguments: object) -> Outcome:
        status = 0
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as stop:
            status = stop.code if isinstance(stop.code, int) else 1
        return Outcome(status, *capsys.readouterr())

    return call


@pytest.fixture(scope="session")
def pocketgs_process() -> Callable[..., subprocess.Popen[str]]:
    """A function that starts `pocketgs` with arguments in a process of its own."""

    def start(*arguments: object, program: str = "from pocketgs.cli import main; main()") -> subprocess.Popen[str]:
        command = [sys.executable, "-c", program, *map(str, arguments)]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    return start


@pytest.fixture(scope="session")
def _trained(written_capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trained") / "result"
    options = ["--prior", "none", "--iterations", "40", "--evaluate-every", "20"]
    main(["train", str(written_capture), "--output", str(folder), *options])
    return folder


@pytest.fixture
def result(_trained: Path, tmp_path: Path) -> Path:
    """The result of 40 iterations from the written capture's own points, for the test to do with as it likes."""
    return Path(shutil.copytree(_trained, tmp_path / "result"))


@pytest.fixture(scope="session")
def _small_demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("demo")
    with pytest.MonkeyPatch.context() as patch:
        small = partial(write_demo, width=160, height=120, frames=20)
        patch.setattr(demo, "write_demo", small)
        options = ["--iterations", "100", "--sh-degree", "1", "--max-gaussians", "3000"]
        main(["demo", "--output", str(folder / "result"), "--capture", str(folder / "capture"), *options])
    return folder


@pytest.fixture
def small_demo(_small_demo: Path, tmp_path: Path) -> Path:
    """A folder with `capture` and `result` that `pocketgs demo` has left, of a small demo."""
    return Path(shutil.copytree(_small_demo, tmp_path / "demo"))
