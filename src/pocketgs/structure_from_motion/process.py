"""Running COLMAP in a child process; see `pocketgs.structure_from_motion.job` for the reasons."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pocketgs.errors import PocketGSError
from pocketgs.structure_from_motion.work import Count
from pocketgs.system.cores import usable_cores
from pocketgs.system.free_memory import free_memory

# Measured for SIFT, which first doubles the image's size.
BYTES_PER_PIXEL_AND_THREAD = 300


def check_installed() -> None:
    """Check that pycolmap is installed, without loading it.

    Raises:
        PocketGSError: it is not installed.
    """
    if find_spec("pycolmap") is None:
        raise PocketGSError(
            "poses of photographs are found by COLMAP, whose package pycolmap is not installed: pip install "
            "'pycolmap>=4.0' (it is built for Linux and Windows on x86-64 and for macOS 14 or later on Apple silicon), "
            "or find poses on such a machine with pocketgs pose and bring the folder here"
        )


def threads_that_fit(pixels: int) -> int:
    """Number of threads that can extract features from images of so many pixels within half of the free memory."""
    fitting = free_memory() / 2 // (BYTES_PER_PIXEL_AND_THREAD * max(1, pixels))
    return max(1, min(usable_cores(), int(fitting)))


def run_colmap(
    module: str,
    job: Mapping[str, Any],
    log: Path,
    on_stage: Callable[[str], None],
    on_count: Count = lambda done, of: None,
) -> dict[str, Any]:
    """Run a job and return its result.

    Args:
        module: of this package, whose `run` does the job: "colmap" or "triangulation".
        job: what the module's `run` takes.
        log: file for COLMAP's stderr, in a folder of this program's own.
        on_stage: called with a stage's name when it begins.
        on_count: called with the progress of the stage.

    Raises:
        PocketGSError: COLMAP failed or was killed.
    """
    command = [sys.executable, "-m", f"{__package__}.{module}"]
    outcome = None
    with (
        log.open("w", encoding="utf-8") as errors,
        # Python imports from the working folder first, which may be an untrusted download.
        subprocess.Popen(
            command,
            cwd=log.parent,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            encoding="utf-8",
        ) as process,
    ):
        assert process.stdin
        assert process.stdout
        try:
            with process.stdin:
                json.dump(job, process.stdin)
            for line in process.stdout:
                message = json.loads(line)
                if "stage" in message:
                    on_stage(message["stage"])
                if "done" in message:
                    on_count(message["done"], message["of"])
                outcome = message.get("outcome")
        except BaseException:
            process.kill()
            raise
    if process.returncode != 0 or outcome is None:
        said = log.read_text(encoding="utf-8", errors="replace").split("\n")
        reason = next((line for line in reversed(said) if line.strip()), f"status {process.returncode}")
        raise PocketGSError(f"COLMAP failed ({reason.strip()})")
    return dict(outcome)
