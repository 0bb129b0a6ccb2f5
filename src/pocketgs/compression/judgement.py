"""Expected quality of a compressed scene on views that it was not trained on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.compression.views import Views
from pocketgs.metrics.evaluation import squared_error
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.training.validation import render_frame


@dataclass(frozen=True)
class Judge:
    """Compares scenes with the original.

    The original was trained on the judging photographs, and fits them better than others. So drops are not compared in
    dB: the growth of the squared error is added to the error of the original on the held-out photographs. No compressed
    scene is compared with those.

    Attributes:
        engine: renders.
        views: the views of the compression.
        own: mean squared error of the original on the judging views, per view.
        unseen: the same on views that it was not trained on; equal to `own` if there are none.
    """

    engine: Engine
    views: Views
    own: np.ndarray
    unseen: np.ndarray

    @staticmethod
    def of(original: Gaussians, engine: Engine, views: Views) -> Judge:
        """Make the judge of scenes made from this one."""
        own = errors(engine, original, views, views.judges)
        # Renderings of the original have no error except rounding, from any camera.
        unseen = errors(engine, original, views, views.reported) if views.photographs and views.reported else own
        return Judge(engine, views, own, unseen)

    def psnr(self, scene: Gaussians) -> float:
        """Expected PSNR in dB; if there are no photographs, the PSNR against renderings of the original."""
        squared = errors(self.engine, scene, self.views, self.views.judges)
        if not self.views.photographs:
            return _mean_psnr(squared)
        return _mean_psnr(np.maximum(self.unseen + (squared - self.own).mean(), 0.1 * self.unseen))

    @property
    def original_psnr(self) -> float:
        """PSNR of the original in dB, comparable with `psnr`."""
        return _mean_psnr(self.unseen)


def errors(engine: Engine, scene: Gaussians, views: Views, frames: list[Frame]) -> np.ndarray:
    """(V,) mean squared error of a scene on some views."""
    engine.upload(scene)
    found = [
        squared_error(render_frame(engine, frame, views.background), frame.image / 255.0, frame.mask)
        for frame in frames
    ]
    return np.array(found)


def _mean_psnr(squared: np.ndarray) -> float:
    return float(np.mean(-10.0 * np.log10(np.maximum(squared, 1e-10))))
