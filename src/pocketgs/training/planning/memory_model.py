"""How much memory the stages of a run hold at most.

Sums of what each stage allocates, with factors measured by `VmHWM` stage by stage; `docs/budgets.md` compares them
with whole runs. They are upper bounds: of a capture without texture fusion merges fewer pixels, for one.
"""

from __future__ import annotations

from pocketgs.capture.loading import MAX_WORKERS
from pocketgs.prior.depth_range import MOST as MAX_HYPOTHESES
from pocketgs.prior.volume import DEPTHS, KEPT
from pocketgs.splat.engine import MemoryNeed
from pocketgs.training.planning.work import Work

MB = 1_000_000

LIBRARIES = 25 * MB
"""What is loaded after planning."""

KERNELS = 30 * MB
"""Machine code of the engine."""

COMPILER = 350 * MB
"""What the compiler keeps once it has run."""

OBJECTS = 1.1
"""Arrays of photographs, with the space between them."""

DECODING, DECODING_ALPHA = 24, 40
"""Bytes by pixel of a photograph that is being read, and more where it has alpha."""

SIFT_PIXEL = 210
"""Bytes by pixel of features being found: grey levels at twice the size, six blurred copies, and their differences."""

MATCHING = 70 * MB
SPARSE = 75 * MB
"""Features, and tables of their products; what is kept of them, with the kernels of the prior."""

ADJUSTMENT = 110 * MB
"""Machine code of what refines poses, and its systems of equations: as if they were refined."""

SWEEP_DEPTH, SWEEP_PIXEL, SWEEP_SOURCE = 3, 40, 4
"""Bytes by pixel and depth: a cost of one byte, and a sum of two. Bytes by pixel: its copies, and a source view."""

MAP_PIXEL = 8
"""Depth and margin in float32."""

CANDIDATE = 250
"""Bytes of a pixel that is merged: 72 of its own, their copies when all are joined, and voxel numbers being sorted."""

RAY_DEPTH = 90
"""Bytes for each depth tried on the ray of a point that is drawn."""

COMPARED_PIXEL = 240
"""Bytes by pixel of an SSIM: ten images in float64."""


def stage_bytes(work: Work, engine: MemoryNeed, resident: int, compiles: bool, readers: int) -> dict[str, int]:
    """Resident memory by stage, in bytes, each with what earlier stages have left.

    Args:
        work: the run.
        engine: what the engine is going to hold.
        resident: what the process holds now.
        compiles: whether kernels are compiled on the way.
        readers: threads that read photographs.
    """
    outline = work.outline
    base = resident + LIBRARIES + (COMPILER if compiles else 0)
    images = int(OBJECTS * outline.image_bytes)
    decoding = DECODING + (DECODING_ALPHA if outline.pixel_bytes > 3 else 0)
    stages = {"capture": base + images + min(readers, MAX_WORKERS) * outline.stored_pixels * decoding}
    held = base + images
    if work.has_prior:
        views = min(work.threads, len(outline.training))
        held += ADJUSTMENT if work.options.bundle else 0
        held += images if work.options.exposure != "off" else 0  # a second copy, at one exposure
        stages["poses"] = held + MATCHING + views * SIFT_PIXEL * outline.pixels
        held += SPARSE
    if work.has_depth:
        copies = _sweep_copies(work)
        maps = work.keyframes * MAP_PIXEL * work.sweep_pixels
        by_pixel = SWEEP_PIXEL + SWEEP_SOURCE * work.options.source_views
        volume = work.sweep_pixels * (SWEEP_DEPTH * MAX_HYPOTHESES + by_pixel)
        stages["depth"] = held + copies + maps + volume + KERNELS
        stages["fusion"] = held + copies + maps + CANDIDATE * work.candidates + KERNELS // 2
    else:
        rays = int(work.gaussians / KEPT) // len(outline.training) + 1
        stages["points"] = held + rays * DEPTHS * RAY_DEPTH
    seeds = work.gaussians * _bytes_outside_engine(work.columns)
    stages["training"] = held + KERNELS + seeds + engine.process + COMPARED_PIXEL * outline.pixels
    return stages


def _sweep_copies(work: Work) -> int:
    """Photographs that are larger than a sweep takes are copied at its size."""
    if work.outline.pixels <= work.sweep_pixels:
        return 0
    return int(OBJECTS * work.outline.pixel_bytes * work.sweep_pixels * len(work.outline.training))


def _bytes_outside_engine(columns: int) -> int:
    """By Gaussian: the point it came from, in float64; the seed; a copy of the result and of the optimiser's state."""
    return 80 + 4 * columns * (1 + 1 + 2)
