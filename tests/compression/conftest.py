"""A small trained scene, and compressions of a few steps."""

from __future__ import annotations

import pytest

from pocketgs.capture import Capture
from pocketgs.compression import candidates
from pocketgs.compression.views import Views, photographed
from pocketgs.prior.prior import PreparedCapture
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.engine import Engine, EngineOptions
from pocketgs.training.train import train


@pytest.fixture(scope="session")
def scene(small_capture: Capture) -> Gaussians:
    """The small capture after 100 iterations from its own 2000 points."""
    prepared = PreparedCapture.of(small_capture, None)
    return train(prepared, iterations=100, engine="cpu", evaluate_every=0).scene


@pytest.fixture(scope="session")
def engine() -> Engine:
    """The shared engine, with the scene of the last upload."""
    return create_engine(EngineOptions(engine="cpu"))


@pytest.fixture
def views(small_capture: Capture) -> Views:
    """The photographs of the small capture."""
    return photographed(small_capture)


@pytest.fixture
def _few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compressions take a twentieth of their steps."""
    for name in ("TUNING_STEPS", "ROUNDING_STEPS", "PRUNING_STEPS", "MASK_STEPS", "STEPS"):
        monkeypatch.setattr(candidates, name, getattr(candidates, name) // 20)
