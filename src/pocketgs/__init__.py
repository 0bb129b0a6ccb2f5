"""PocketGS turns a phone capture into a 3D Gaussian splat on whatever device is at hand.

    import pocketgs
    capture = pocketgs.open_capture("fern", images="images_8")
    result = pocketgs.train(capture, iterations=500)
    result.scene.save("fern.ply")

Names are imported on first use, so `import pocketgs` is quick and loads no engine.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    __version__: str
    from pocketgs.capture.capture import Capture, Frame
    from pocketgs.capture.open import open_capture
    from pocketgs.capture.options import CaptureOptions
    from pocketgs.capture.synthetic import demo_capture
    from pocketgs.errors import PocketGSError
    from pocketgs.geometry.camera import Camera
    from pocketgs.geometry.lens import Lens
    from pocketgs.metrics.evaluation import evaluate
    from pocketgs.scene.gaussians import Gaussians
    from pocketgs.scene.morton import morton_order
    from pocketgs.scene.point_cloud import PointCloud
    from pocketgs.splat.engine import EngineOptions, Rendering
    from pocketgs.splat.optimiser import Adam, photometric_loss
    from pocketgs.splat.rasterizer import Rasterizer
    from pocketgs.splat.rendering import render, render_all
    from pocketgs.splat.settings import AdamSettings, LearningRates, LossSettings
    from pocketgs.training.options import TrainingOptions
    from pocketgs.training.preparation import prepare
    from pocketgs.training.train import train

__all__ = [
    "Adam",
    "AdamSettings",
    "Camera",
    "Capture",
    "CaptureOptions",
    "EngineOptions",
    "Frame",
    "Gaussians",
    "LearningRates",
    "Lens",
    "LossSettings",
    "PocketGSError",
    "PointCloud",
    "Rasterizer",
    "Rendering",
    "TrainingOptions",
    "demo_capture",
    "evaluate",
    "morton_order",
    "open_capture",
    "photometric_loss",
    "prepare",
    "render",
    "render_all",
    "train",
]

_HOMES = {
    "Adam": "splat.optimiser",
    "AdamSettings": "splat.settings",
    "Camera": "geometry.camera",
    "Capture": "capture.capture",
    "CaptureOptions": "capture.options",
    "EngineOptions": "splat.engine",
    "Frame": "capture.capture",
    "Gaussians": "scene.gaussians",
    "LearningRates": "splat.settings",
    "Lens": "geometry.lens",
    "LossSettings": "splat.settings",
    "PocketGSError": "errors",
    "PointCloud": "scene.point_cloud",
    "Rasterizer": "splat.rasterizer",
    "Rendering": "splat.engine",
    "TrainingOptions": "training.options",
    "demo_capture": "capture.synthetic",
    "evaluate": "metrics.evaluation",
    "morton_order": "scene.morton",
    "open_capture": "capture.open",
    "photometric_loss": "splat.optimiser",
    "prepare": "training.preparation",
    "render": "splat.rendering",
    "render_all": "splat.rendering",
    "train": "training.train",
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return version("pocketgs")
    if name not in _HOMES:
        raise AttributeError(f"module 'pocketgs' has no attribute {name!r}")
    return getattr(import_module(f"pocketgs.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
