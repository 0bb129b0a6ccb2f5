"""Memory model: the peak memory of each stage of a run.

Sums of each stage's allocations, with factors measured by `VmHWM` stage by stage; `docs/budgets.md` compares them with
whole runs. They are upper bounds: in a capture without texture, for example, fusion merges fewer pixels.
"""

from __future__ import annotations

from pocketgs.capture.loading import MAX_WORKERS
from pocketgs.prior.cloud.volume import DEPTHS, KEPT
from pocketgs.prior.depth.stereo import StereoNeed
from pocketgs.system.memory_need import MemoryNeed
from pocketgs.training.planning.work import Work

MB = 1_000_000

LIBRARIES = 25 * MB
"""Libraries loaded after planning."""

KERNELS = 30 * MB
"""Machine code of the engine."""

COMPILER = 350 * MB
"""Memory that the compiler keeps after use."""

OBJECTS = 1.1
"""Arrays of photographs, including fragmentation."""

DECODING, DECODING_ALPHA = 24, 40
"""Bytes per pixel while a photograph is read, and with alpha."""

SIFT_PIXEL = 210
"""Bytes per pixel during feature detection: grey levels at double size, six blurred copies, and their differences."""

MATCHING = 70 * MB
SPARSE = 75 * MB
"""Features and tables of their products during matching; what remains of them, with the kernels of the prior."""

ADJUSTMENT = 110 * MB
"""Machine code and equations of bundle adjustment, assuming that poses are refined."""

MAP_PIXEL = 8
"""Depth and margin as float32."""

CANDIDATE = 250
"""Bytes per candidate pixel of fusion: 72 of its own, copies when all are joined, and voxel keys while sorting."""

RAY_DEPTH = 90
"""Bytes per depth tested on the ray of a random point."""

COMPARED_PIXEL = 240
"""Bytes per pixel of SSIM: ten images in float64."""


def stage_bytes(
    work: Work, engine: MemoryNeed, stereo: StereoNeed, resident: int, compiles: bool, readers: int
) -> dict[str, int]:
    """Resident memory by stage in bytes, including what earlier stages have left.

    Args:
        work: the run.
        engine: memory that the engine will use.
        stereo: memory that depth will use.
        resident: current resident memory of the process.
        compiles: whether kernels must still be compiled.
        readers: threads that decode photographs.
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
        held += images if work.options.exposure != "off" else 0  # an exposure-compensated copy
        stages["poses"] = held + MATCHING + views * SIFT_PIXEL * outline.pixels
        held += SPARSE
    if work.has_depth:
        copies = _sweep_copies(work)
        maps = work.keyframes * MAP_PIXEL * work.sweep_pixels
        stages["depth"] = held + copies + maps + stereo.sweeping.process + KERNELS
        stages["fusion"] = held + copies + maps + CANDIDATE * work.candidates + stereo.comparing.process + KERNELS // 2
    else:
        rays = int(work.gaussians / KEPT) // len(outline.training) + 1
        stages["points"] = held + rays * DEPTHS * RAY_DEPTH
    seeds = work.gaussians * _bytes_outside_engine(work.columns)
    stages["training"] = held + KERNELS + seeds + engine.process + COMPARED_PIXEL * outline.pixels
    return stages


def _sweep_copies(work: Work) -> int:
    """Bytes of the reduced copies of photographs that are larger than a sweep uses."""
    if work.outline.pixels <= work.sweep_pixels:
        return 0
    return int(OBJECTS * work.outline.pixel_bytes * work.sweep_pixels * len(work.outline.training))


def _bytes_outside_engine(columns: int) -> int:
    """Bytes per Gaussian: its float64 point, the seed, and a copy of the result and of the optimiser's state."""
    return 80 + 4 * columns * (1 + 1 + 2)
