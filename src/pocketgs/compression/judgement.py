"""Expected quality of a compressed scene on views that it was not trained on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.capture.even_choice import evenly_chosen
from pocketgs.compression.views import Views
from pocketgs.metrics.evaluation import squared_error
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.splat.rendering import render_frame

TRAINING_VIEWS = 40
"""Maximum number of training views for the estimate that replaces held-out ones."""

WORTH = 1.0
"""Weight of the estimate from training views, in held-out photographs. Both err about equally: a loss of 0.3 dB differs
from one photograph to another by 0.1 dB on fern and 0.25 on lego, and the estimate from their mean by 0.27 and 0.03."""

SPREAD = 0.8
"""Standard deviation of the loss from one photograph to another, relative to their mean."""


@dataclass(frozen=True)
class Judge:
    """Compares scenes with the original.

    Against photographs, the loss is a weighted mean of two: that on the judging photographs, which are held out, and an
    estimate from training views, which counts as much as `WORTH` photographs. The original was trained on these and
    fits them better than others, so drops on them are not compared in dB: the growth of the squared error is added to
    the error of the original on views that it was not trained on. For originals that overfit, this overstates the loss.

    Attributes:
        engine: renders.
        views: the views of the compression.
        trained: training views for the estimate; empty if there are no photographs.
        own: mean squared error of the original on these, per view.
        unseen: the same on the judging views. If there are none, on the reported ones, with which only the original is
            compared; without these, `own`.
        least: PSNR in dB, per judging view, of a scene that the others are not to be worse than, or None.
    """

    engine: Engine
    views: Views
    trained: list[Frame]
    own: np.ndarray
    unseen: np.ndarray
    least: np.ndarray | None = None

    @staticmethod
    def of(original: Gaussians, engine: Engine, views: Views) -> Judge:
        """Make the judge of scenes made from this one."""
        chosen = evenly_chosen(len(views.train), TRAINING_VIEWS)
        trained = [views.train[place] for place in chosen] if views.photographs else []
        own = errors(engine, original, views, trained)
        others = views.judges or views.reported
        unseen = errors(engine, original, views, others) if others else own
        return Judge(engine, views, trained, own, unseen)

    def expecting(self, least: Gaussians) -> Judge:
        """The judge, without photographs, of scenes that are not to be worse than this one."""
        return replace(self, least=_psnr(errors(self.engine, least, self.views, self.views.judges)))

    def psnr(self, scene: Gaussians) -> float:
        """Expected PSNR in dB; if there are no photographs, the PSNR against renderings of the original.

        What is not to be worse than another scene must not be so on the median view either: views from where nobody
        has photographed differ by 10 dB, and a few of them decide the mean.
        """
        seen = len(self.views.judges)
        by_view = _psnr(errors(self.engine, scene, self.views, self.views.judges)) if seen else np.zeros(1)
        on_judges = float(by_view.mean())
        if self.least is not None:
            gains = by_view - self.least
            return float(self.least.mean() + min(gains.mean(), np.median(gains)))
        if not self.trained:
            return on_judges
        return (seen * on_judges + WORTH * self.psnr_by_training_views(scene)) / (seen + WORTH)

    def psnr_by_training_views(self, scene: Gaussians) -> float:
        """PSNR in dB that the training views alone let expect: less exact, but not noisy."""
        growth = (errors(self.engine, scene, self.views, self.trained) - self.own).mean()
        return float(_psnr(np.maximum(self.unseen + growth, 0.1 * self.unseen)).mean())

    def loss_to_aim_at(self, allowed: float) -> float:
        """The measured loss, in dB, at which the loss on all other photographs is likely to be at most `allowed`.

        A mean over few photographs may be lucky, and a search for the smallest file picks what is: the loss measured
        and one standard error of it must be within what is allowed. Renderings of the original are not that few.
        """
        if not self.trained:
            return allowed
        return allowed / (1.0 + SPREAD / float(np.sqrt(len(self.views.judges) + WORTH)))

    @property
    def renderings(self) -> int:
        """Number of renderings that `psnr` takes."""
        return len(self.trained) + len(self.views.judges)

    @property
    def original_psnr(self) -> float:
        """PSNR of the original in dB, comparable with `psnr`."""
        return float(_psnr(self.unseen).mean())


def errors(engine: Engine, scene: Gaussians, views: Views, frames: list[Frame]) -> np.ndarray:
    """(V,) mean squared error of a scene on some views."""
    engine.upload(scene)
    found = [
        squared_error(render_frame(engine, frame, views.background), frame.image / 255.0, frame.mask)
        for frame in frames
    ]
    return np.array(found)


def _psnr(squared: np.ndarray) -> np.ndarray:
    """PSNR in dB of each mean squared error."""
    return np.asarray(-10.0 * np.log10(np.maximum(squared, 1e-10)))
