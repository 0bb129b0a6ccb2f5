"""Captures that tests of the prior share, and their sparse structure."""

from __future__ import annotations

import pytest

from pocketgs.capture import Capture
from pocketgs.capture.synthetic import true_capture
from pocketgs.prior.poses.structure import Structure, StructureSettings, build_structure
from pocketgs.prior.scale import estimate_scale


@pytest.fixture(scope="session")
def clean_walk() -> Capture:
    """Twelve views of the demo scene with exact poses, 240 x 180: large enough for features."""
    return true_capture(width=240, height=180, frames=12, points=1500)


@pytest.fixture(scope="session")
def clean_structure(clean_walk: Capture) -> Structure:
    """Points seen by the training frames of `clean_walk`, all of which are keyframes."""
    structure = build_structure(clean_walk.train, estimate_scale(clean_walk), StructureSettings())
    assert structure is not None
    return structure
