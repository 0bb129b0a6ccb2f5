"""Shared fixtures of all tests."""

from __future__ import annotations

import json
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings
from PIL import Image
from plyfile import PlyData, PlyElement

from missing import unavailable
from pocketgs.capture import Capture
from pocketgs.capture.synthetic import true_capture
from pocketgs.gpu.adapters import Adapter, adapters
from pocketgs.system.process import resident_bytes
from pocketgs.training.planning import machine

# Examples may take long where the machine is busy or a kernel is compiled first.
settings.register_profile("without_deadline", parent=settings(), deadline=None)
settings.load_profile("without_deadline")

RESIDENT_AT_START = 400_000_000
"""Most bytes that a command's process holds when it plans its run."""


@pytest.fixture(scope="session", autouse=True)
def _ctrl_c_can_come() -> None:
    """Tests press Ctrl-C. Under `nohup` it would be ignored, here and in all processes that tests start."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def _runs_plan_as_in_a_process_of_their_own() -> Iterator[None]:
    """Hide from plans what other tests leave in this process: compiled kernels, and drivers."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(machine, "resident_bytes", lambda: min(resident_bytes(), RESIDENT_AT_START))
        yield


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real captures, from POCKETGS_DATA or beside the repository; tests without it are skipped."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("POCKETGS_DATA", beside))
    if not folder.is_dir():
        pytest.skip(f"no real captures at {folder}: set POCKETGS_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def adapter() -> Adapter:
    """The best WebGPU device, including software ones."""
    if not adapters():
        unavailable("no Vulkan, Metal or DX12 adapter: install a driver, such as Mesa's software Vulkan")
    return adapters()[0]


@pytest.fixture(scope="session")
def small_capture() -> Capture:
    """Eight views of the demo scene, 96 x 72, one of them held out."""
    return true_capture(width=96, height=72, frames=8, points=2000)


@pytest.fixture(scope="session")
def written_capture(small_capture: Capture, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`small_capture` on disk as nerfstudio writes it, to be read only."""
    folder = tmp_path_factory.mktemp("written") / "toys"
    write_nerfstudio(small_capture, folder)
    return folder


@pytest.fixture
def capture_folder(written_capture: Path, tmp_path: Path) -> Path:
    """A copy of `written_capture` for the test to do with as it likes."""
    return Path(shutil.copytree(written_capture, tmp_path / "toys"))


def write_nerfstudio(capture: Capture, folder: Path) -> None:
    """Write a capture as transforms.json, images/*.png and a coloured cloud.ply."""
    assert capture.points is not None
    (folder / "images").mkdir(parents=True)
    frames = []
    for frame in sorted(capture.frames, key=lambda frame: frame.name):
        Image.fromarray(frame.image).save(folder / "images" / frame.name)
        to_world = frame.camera.camera_to_world * np.array([1, -1, -1, 1])
        frames.append({"file_path": f"images/{frame.name}", "transform_matrix": to_world.tolist()})
    camera = capture.train[0].camera
    document = {
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "w": camera.width,
        "h": camera.height,
        "ply_file_path": "cloud.ply",
        "frames": frames,
    }
    (folder / "transforms.json").write_text(json.dumps(document))
    columns = [*capture.points.positions.T, *np.round(capture.points.colours.T * 255).astype(np.uint8)]
    types = [(name, "f4") for name in "xyz"] + [(name, "u1") for name in ("red", "green", "blue")]
    vertices = np.rec.fromarrays(columns, dtype=types)
    PlyData([PlyElement.describe(np.asarray(vertices), "vertex")]).write(str(folder / "cloud.ply"))


@pytest.fixture(scope="session")
def contents() -> Callable[[Path], dict[str, bytes]]:
    """A function that returns the content of every file below a folder, by its path there."""

    def read(folder: Path) -> dict[str, bytes]:
        files = (path for path in sorted(folder.rglob("*")) if path.is_file())
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}

    return read
