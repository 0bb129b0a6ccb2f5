"""Size and quality of a scene on the reported views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.compression.views import Views
from pocketgs.metrics.evaluation import psnr, ssim
from pocketgs.scene.background import Background
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine, Renderer
from pocketgs.splat.rendering import render_frame


@dataclass(frozen=True)
class Figures:
    """Size and quality of a scene in a file.

    Attributes:
        name: of the file's format, or of the method.
        gaussians: their number.
        megabytes: of 10^6 bytes, or None if the format cannot store the scene, or there was no time for it.
        psnr: mean over the reported views in dB, or None without any.
        ssim: likewise.
    """

    name: str
    gaussians: int
    megabytes: float | None
    psnr: float | None = None
    ssim: float | None = None


def figures_of(name: str, scene: Gaussians, size: int, engine: Engine, views: Views) -> Figures:
    """Measure a scene.

    Args:
        name: for the table.
        scene: as stored in the file.
        size: of the file in bytes.
        engine: renders.
        views: the views of the compression; the reported ones are used.
    """
    if not views.reported:
        return Figures(name, len(scene), size / 1e6)
    engine.upload(scene)
    return Figures(name, len(scene), size / 1e6, *quality_on(views.reported, engine, views.background))


def quality_on(frames: Sequence[Frame], renderer: Renderer, background: Background) -> tuple[float, float]:
    """Mean PSNR in dB and mean SSIM of what a renderer draws, on at least one photograph."""
    found = []
    for frame in frames:
        image, photo = render_frame(renderer, frame, background), frame.image / np.float32(255.0)
        found.append((psnr(image, photo, frame.mask), ssim(image, photo, frame.mask)))
    decibels, similarity = np.mean(found, axis=0)
    return float(decibels), float(similarity)
