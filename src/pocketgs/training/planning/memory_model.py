"""Memory model: the peak memory of each stage of a run.

Sums of each stage's allocations, with factors measured by `VmHWM` stage by stage; `docs/budgets.md` compares them with
whole runs. They are upper bounds: in a capture without texture, for example, fusion merges fewer pixels.
"""

from __future__ import annotations

from pocketgs.capture.loading import MAX_READERS
from pocketgs.capture.outline import Outline
from pocketgs.prior.cloud.volume import DEPTHS, KEPT
from pocketgs.prior.depth.stereo import StereoNeed
from pocketgs.prior.features.detection import FEATURES, MAX_AT_ONCE, detection_side
from pocketgs.prior.poses.structure import StructureSettings
from pocketgs.system.device import MB, MemoryNeed
from pocketgs.training.planning.work import Work

LIBRARIES = 25 * MB
"""Libraries loaded after planning."""

KERNELS = 30 * MB
"""Machine code of the engine."""

COMPILER = 350 * MB
"""Memory that the compiler keeps after use."""

OBJECTS = 1.1
"""Arrays of photographs, including fragmentation."""

SIFT_PIXEL = 210
"""Bytes per pixel during feature detection: grey levels at double size, six blurred copies, and their differences."""

MATCHING, MATCHED_FEATURE = 30 * MB, 900
"""Tables of features' products during matching; and bytes per feature: 528 of its own, its matches in other views, and
lists of them while they are linked to tracks. Descriptors are gone when poses are adjusted; up to 2,000 views, the
matrix of all cameras takes less than they did."""

SPARSE, SPARSE_FEATURE = 70 * MB, 75
"""What remains of them, with the kernels of the prior; and per feature, if all are points."""

ADJUSTMENT = 110 * MB
"""Machine code of bundle adjustment and equations of few cameras, assuming that poses are refined."""

MAP_PIXEL = 8
"""Depth and margin as float32."""

CANDIDATE = 250
"""Bytes per candidate pixel of fusion: 72 of its own, copies when all are joined, and voxel keys while sorting."""

RAY_DEPTH = 90
"""Bytes per depth tested on the ray of a random point."""

COMPARED_PIXEL = 240
"""Bytes per pixel of SSIM: ten images in float64."""


def readers_that_fit(work: Work, resident: int, compiles: bool, cores: int) -> int:
    """Number of photographs that may be read at the same time within the memory budget; at least one.

    Args:
        work: the run.
        resident: current resident memory of the process.
        compiles: whether kernels must still be compiled.
        cores: that decode photographs.
    """
    seen = work.seen_by_prior
    each = max(work.outline.reading_bytes, seen.reading_bytes, _detecting(seen) if work.has_prior else 0)
    held = _with_photographs(work.outline, resident, compiles) + _copies(work)
    room = work.options.max_memory * MB - held - _matching(work)
    return max(1, min(cores, MAX_READERS, room // each))


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
        readers: number of photographs that are read at the same time.
    """
    outline, seen = work.outline, work.seen_by_prior
    photographs = _with_photographs(outline, resident, compiles)
    stages = {"capture": photographs + readers * outline.reading_bytes}
    held = photographs + _copies(work)
    if work.has_prior:
        again = readers * max(seen.reading_bytes, _detecting(seen)) if seen.read_again else 0
        in_memory = min(work.threads, MAX_AT_ONCE) * min(SIFT_PIXEL * seen.pixels, _detecting(seen))
        stages["poses"] = held + max(_matching(work) + max(again, in_memory), _after_poses(work, seen))
        held += _after_poses(work, seen)
    if work.has_depth:
        reduced = _sweep_copies(work)
        maps = work.keyframes * MAP_PIXEL * work.sweep_pixels
        stages["depth"] = held + reduced + maps + stereo.sweeping.process + KERNELS
        stages["fusion"] = held + reduced + maps + CANDIDATE * work.candidates + stereo.comparing.process + KERNELS // 2
    else:
        rays = int(work.gaussians / KEPT) // len(outline.training) + 1
        stages["points"] = held + rays * DEPTHS * RAY_DEPTH
    if outline.copies:
        last = "fusion" if work.has_depth else "points"
        stages[last] = max(stages[last], held + _compensated(work, outline))
    held = photographs + (_after_poses(work, outline) if work.has_prior else 0)
    seeds = work.gaussians * _bytes_outside_engine(work.columns)
    stages["training"] = held + KERNELS + seeds + engine.process + COMPARED_PIXEL * outline.pixels
    return stages


def _with_photographs(outline: Outline, resident: int, compiles: bool) -> int:
    """Bytes held once the photographs are read."""
    return resident + LIBRARIES + (COMPILER if compiles else 0) + int(OBJECTS * outline.image_bytes)


def _matching(work: Work) -> int:
    """Bytes of features and matches, besides what the detection of features in single photographs takes."""
    if not work.has_prior:
        return 0
    return _adjustment(work) + MATCHING + MATCHED_FEATURE * _features(work.outline)


def _after_poses(work: Work, photographs: Outline) -> int:
    """Bytes that remain of refining poses and compensating the exposure of photographs."""
    return _adjustment(work) + _compensated(work, photographs) + SPARSE + SPARSE_FEATURE * _features(photographs)


def _compensated(work: Work, photographs: Outline) -> int:
    """Bytes of photographs of compensated exposure."""
    return int(OBJECTS * photographs.image_bytes) if work.options.exposure != "off" else 0


def _copies(work: Work) -> int:
    """Bytes of the undistorted copies that the prior looks at; training looks at the photographs themselves."""
    return int(OBJECTS * work.outline.copies.image_bytes) if work.outline.copies else 0


def _adjustment(work: Work) -> int:
    """Bytes that bundle adjustment takes, if it takes place."""
    return ADJUSTMENT if work.options.bundle else 0


def _features(outline: Outline) -> int:
    """Maximum number of features of all photographs."""
    return min(FEATURES, StructureSettings().features * (len(outline.training) + len(outline.held_out)))


def _detecting(outline: Outline) -> int:
    """Bytes to detect features in a photograph, read again where it is stored larger than it is held."""
    width, height = outline.largest
    side = detection_side((*outline.training, *outline.held_out))
    stored = outline.stored_pixels if outline.read_again else outline.pixels
    return SIFT_PIXEL * min(stored, side**2 * min(width, height) // max(width, height))


def _sweep_copies(work: Work) -> int:
    """Bytes of the reduced copies of photographs that are larger than a sweep uses."""
    seen = work.seen_by_prior
    if seen.pixels <= work.sweep_pixels:
        return 0
    return int(OBJECTS * seen.pixel_bytes * work.sweep_pixels * len(seen.training))


def _bytes_outside_engine(columns: int) -> int:
    """Bytes per Gaussian: its float64 point, the seed, and a copy of the result and of the optimiser's state."""
    return 80 + 4 * columns * (1 + 1 + 2)
