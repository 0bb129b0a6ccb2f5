"""How large a share of the Gaussians steps leave out."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs import Camera, PointCloud
from pocketgs.capture.synthetic import true_capture
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.settings import StepSettings
from pocketgs.training.dropout import MOST_POINTS, dropout_of_step, dropout_share, views_per_point
from pocketgs.training.train import train


def cameras(count: int) -> list[Camera]:
    """Cameras side by side, one unit apart, that look along z and see two units to either side at a depth of two."""
    poses = [np.eye(4) for _ in range(count)]
    for place, pose in enumerate(poses):
        pose[0, 3] = -place
    return [Camera(100, 100, 50.0, 50.0, 50.0, 50.0, pose) for pose in poses]


def test_views_per_point() -> None:
    points = np.array([[0.1, 0, 2], [4.1, 0, 2], [0, 0, -2], [5.1, 0, 2]], float)
    counts = [3, 4, 0, 4]
    for place, count in enumerate(counts):
        assert views_per_point(cameras(8), PointCloud(points[[place]], np.zeros((1, 3)))) == count
    assert views_per_point(cameras(8), PointCloud(points, np.zeros((4, 3)))) == 3.5
    many = np.repeat(points, MOST_POINTS, axis=0)
    assert views_per_point(cameras(8), PointCloud(many, np.zeros((len(many), 3)))) == 3.5


@pytest.mark.parametrize(("views", "share"), [(0, 0.1), (3, 0.1), (8, 0.1), (10, 0.05), (12, 0.0), (300, 0.0)])
def test_shares(views: float, share: float) -> None:
    assert dropout_share(0.1, views) == pytest.approx(share)
    assert dropout_share(0.0, views) == 0.0


def test_steps_choose_differently() -> None:
    found = [dropout_of_step(0.1, iteration, seed) for iteration in (1, 2) for seed in (0, 1)]
    assert len({one.seed for one in found if one}) == 4
    assert dropout_of_step(0.0, 1, 0) is None


class Recording(CpuEngine):
    """Keeps the settings of its steps."""

    def __init__(self) -> None:
        super().__init__(1)
        self.settings: list[StepSettings] = []

    def step(self, view: int, settings: StepSettings) -> None:
        self.settings.append(settings)
        super().step(view, settings)


@pytest.mark.parametrize(
    ("frames", "recipe", "share"), [(6, "pocketgs", 0.1), (24, "pocketgs", 0.0), (6, "reference", 0.0)]
)
def test_runs_with_few_photographs(frames: int, recipe: str, share: float) -> None:
    engine, capture = Recording(), true_capture(width=48, height=36, frames=frames, points=300)
    result = train(capture, opened_engine=engine, engine="cpu", prior="none", iterations=3, recipe=recipe)
    assert result.dropout == share
    assert [one.dropout.share if one.dropout else 0.0 for one in engine.settings] == [share] * 3
