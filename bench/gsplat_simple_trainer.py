"""gsplat's examples/simple_trainer.py, unchanged, on PocketGS's rasterization.

    pip install gsplat==1.5.3 nerfview torchmetrics tensorboard scikit-learn matplotlib pyyaml tqdm "imageio[ffmpeg]"
    git clone --branch v1.5.3 https://github.com/nerfstudio-project/gsplat
    python bench/gsplat_simple_trainer.py gsplat/examples/simple_trainer.py path/to/fern --images images_8
    python bench/gsplat_simple_trainer.py ... --strategy mcmc --steps 500 --pose_opt --visible_adam

What this script does not know goes to the trainer. Two more things are replaced: LPIPS, whose weights come from the
network, is left out; and the COLMAP model comes from PocketGS's reader, so that any capture will do.
"""

from __future__ import annotations

import runpy
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Annotated, Any, Literal

import cv2
import numpy as np
import torch
import tyro

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import read_capture
from pocketgs.torch import install_as_gsplat

PINHOLE = 1
"""COLMAP's number of this camera model."""


@dataclass(frozen=True)
class Options:
    """Train and evaluate.

    Attributes:
        trainer: simple_trainer.py, in the folder of gsplat's examples.
        capture: With a point cloud of its own.
        strategy: The trainer's subcommand.
        steps: To take. The held-out views are rendered after the last.
        results: Where the trainer writes.
        reading: How to read the capture.
    """

    trainer: Annotated[Path, tyro.conf.Positional]
    capture: Annotated[Path, tyro.conf.Positional]
    strategy: Literal["default", "mcmc"] = "default"
    steps: int = 200
    results: Path = Path("results/simple_trainer")
    reading: CaptureOptions = CaptureOptions()  # noqa: RUF009 - a frozen dataclass


def main() -> None:
    """Run the trainer as its own command line would."""
    options, more = tyro.cli(Options, return_unknown_args=True, config=(tyro.conf.OmitArgPrefixes,))
    opened = read_capture(options.capture, options.reading)
    if opened.points is None:
        raise SystemExit(f"{options.capture}: has no cloud of its own, expected one with points to start from")
    if not all(frame.camera.is_pinhole for frame in (*opened.train, *opened.held_out)):
        raise SystemExit(f"{options.capture}: has cameras with a lens, expected pinholes: --lens undistort")
    install_as_gsplat(cuda_means_cpu=True)
    leave_lpips_out()
    sys.modules["pycolmap"] = pycolmap_of(opened)
    sys.path.insert(0, str(options.trainer.parent))
    with tempfile.TemporaryDirectory() as folder:
        write_photographs(opened, Path(folder))
        own = {
            "data_dir": folder,
            "data_factor": 1,
            "result_dir": options.results,
            "max_steps": options.steps,
            "eval_steps": options.steps,
        }
        named = [str(each) for name, value in own.items() for each in (f"--{name}", value)]
        sys.argv = [str(options.trainer), options.strategy, *named, "--disable_viewer", "--disable_video", *more]
        runpy.run_path(str(options.trainer), run_name="__main__")


def frames_by_name(opened: Capture) -> list[tuple[str, Frame]]:
    """Frames under names in whose order every eighth, from the first, is held out, as the trainer does."""
    train, held_out = list(opened.train), list(opened.held_out)
    frames: list[Frame] = []
    while train or held_out:
        own = held_out if held_out and (len(frames) % 8 == 0 or not train) else train
        frames.append(own.pop(0))
    return [(f"{number:05}.png", frame) for number, frame in enumerate(frames)]


def write_photographs(opened: Capture, folder: Path) -> None:
    """Write the folders in which the trainer looks for a COLMAP model and photographs."""
    (folder / "sparse/0").mkdir(parents=True)
    (folder / "images").mkdir()
    for name, frame in frames_by_name(opened):
        cv2.imwrite(str(folder / "images" / name), frame.image[..., ::-1])


def pycolmap_of(opened: Capture) -> ModuleType:
    """The module `pycolmap` of the trainer's requirements, as far as it is used, with the model of this capture."""
    module = ModuleType("pycolmap")
    module.SceneManager = lambda folder: SceneManager(opened)  # type: ignore[attr-defined]
    return module


class SceneManager:
    """A COLMAP model with a camera for each photograph."""

    def __init__(self, opened: Capture) -> None:
        assert opened.points is not None
        self.cameras, self.images, self.name_to_image_id = {}, {}, {}
        for number, (name, frame) in enumerate(frames_by_name(opened)):
            self.cameras[number] = SimpleNamespace(
                camera_type=PINHOLE,
                **{each: getattr(frame.camera, each) for each in ("fx", "fy", "cx", "cy", "width", "height")},
            )
            self.images[number] = Image(name, number, frame.camera.world_to_camera)
            self.name_to_image_id[name] = number
        self.points3D = opened.points.positions
        self.point3D_colors = np.round(255.0 * opened.points.colours)
        self.point3D_errors = np.zeros(len(self.points3D))
        self.point3D_id_to_images: dict[int, Any] = {}
        self.point3D_id_to_point3D_idx: dict[int, int] = {}

    def load_cameras(self) -> None:
        """They are there."""

    load_images = load_points3D = load_cameras  # noqa: N815 - pycolmap's name


@dataclass(frozen=True)
class Image:
    """A photograph of a COLMAP model."""

    name: str
    camera_id: int
    world_to_camera: np.ndarray

    def R(self) -> np.ndarray:  # noqa: N802 - pycolmap's name
        """(3, 3) world to camera."""
        return self.world_to_camera[:3, :3]

    @property
    def tvec(self) -> np.ndarray:
        """(3,) world to camera."""
        return self.world_to_camera[:3, 3]


class NoLpips(torch.nn.Module):
    """NaN in place of a distance."""

    def forward(self, image: torch.Tensor, photograph: torch.Tensor) -> torch.Tensor:
        """A scalar."""
        return torch.tensor(torch.nan)


def leave_lpips_out() -> None:
    """Replace it, as its weights would be loaded from the network."""
    import torchmetrics.image.lpip

    torchmetrics.image.lpip.LearnedPerceptualImagePatchSimilarity = lambda **options: NoLpips()


if __name__ == "__main__":
    main()
