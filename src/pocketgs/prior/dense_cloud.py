"""The dense cloud: depth maps of the keyframes, fused, and completed where training views see no points."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.errors import PocketGSError
from pocketgs.prior.cloud.complete import Completion, completion, joined
from pocketgs.prior.cloud.fuse import FusionSettings, fuse
from pocketgs.prior.cloud.merge import Candidates
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.depth_maps import depth_maps, stereo_extent
from pocketgs.prior.depth.room import with_room
from pocketgs.prior.depth.stereo import Stereo
from pocketgs.prior.depth.sweep import DepthMap, SweepSettings
from pocketgs.prior.devices import Devices
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.system.stopwatch import Stopwatch


@dataclass(frozen=True, eq=False)
class SparseScene:
    """The training frames, and what is known of the scene before depth is computed.

    Attributes:
        frames: training frames.
        keyframes: indices of those whose depth is computed.
        seen: for each training frame, (N, 3) points that it sees.
        sources: points for what depth does not cover, best first.
        distance: typical distance to the scene.
    """

    frames: Sequence[Frame]
    keyframes: Sequence[int]
    seen: Sequence[np.ndarray]
    sources: Sequence[PointCloud]
    distance: float


@dataclass(frozen=True, eq=False)
class DenseCloud:
    """A dense cloud and how it was made.

    Attributes:
        points: the cloud.
        completion: what was added to the fused points.
        swept_on: device that computed depth, "cpu" or "webgpu".
        warnings: for the user.
    """

    points: PointCloud
    completion: Completion
    swept_on: str
    warnings: tuple[str, ...]


def dense_cloud(
    scene: SparseScene,
    count: int,
    sweep: SweepSettings,
    fusion: FusionSettings,
    devices: Devices,
    stopwatch: Stopwatch,
) -> DenseCloud:
    """Compute the depth of keyframes, fuse it, and complete it from other sources.

    Args:
        scene: what is known of it.
        count: maximum number of points.
        sweep: settings of depth maps.
        fusion: settings of their fusion.
        devices: compute depth and merge; the CPU does where a GPU has no room, or fails.
        stopwatch: times the stages.
    """
    candidates, swept_on, warnings = _confirmed(scene, sweep, fusion, devices.stereo, stopwatch)
    with stopwatch.stage("fusion"):
        fused = devices.merger.merged(candidates, count)
    with stopwatch.stage("coverage"):
        complete = completion(fused, scene.frames, scene.sources, scene.distance, count)
        if len(fused) + len(complete.added) > count:
            fused = devices.merger.merged(candidates, count - len(complete.added))
        return DenseCloud(joined([fused, complete.added]), complete, swept_on, warnings)


def _confirmed(
    scene: SparseScene, sweep: SweepSettings, fusion: FusionSettings, stereo: Stereo, stopwatch: Stopwatch
) -> tuple[Candidates, str, tuple[str, ...]]:
    """Pixels whose depth is confirmed, the device that computed it, and warnings. Depth maps are released on return."""
    with ExitStack() as held:
        with stopwatch.stage("depth"):
            sizes = [(frame.camera.width, frame.camera.height) for frame in scene.frames]
            stereo, warnings = with_room(stereo, stereo_extent(sizes, len(scene.keyframes), sweep))
            held.callback(stereo.release)
            keyframes = [scene.frames[index] for index in scene.keyframes]
            points = [scene.seen[index] for index in scene.keyframes]
            swept, maps = depth_maps(keyframes, scene.frames, points, scene.distance, sweep, stereo)
        with stopwatch.stage("fusion"):
            candidates, failed = _candidates(swept, maps, scene.frames, fusion, stereo)
        return candidates, stereo.name, (*warnings, *failed)


def _candidates(
    keyframes: Sequence[Frame],
    maps: Sequence[DepthMap],
    frames: Sequence[Frame],
    settings: FusionSettings,
    stereo: Stereo,
) -> tuple[Candidates, tuple[str, ...]]:
    """See `fuse`; on the CPU if the GPU fails, so that its sweeps are not lost; and warnings."""
    try:
        return fuse(keyframes, maps, frames, settings, stereo), ()
    except PocketGSError as error:
        if stereo.name == "cpu":
            raise
        warning = f"depth maps are compared on the CPU: {error}"
    return fuse(keyframes, maps, frames, settings, CpuStereo()), (warning,)
