"""`pocketgs info`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from pocketgs.capture import ListedCapture, list_capture
from pocketgs.capture.open import lacks_poses, video_of
from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import check_without_capture
from pocketgs.cli.devices import device_lines
from pocketgs.cli.run_lines import capture_lines
from pocketgs.cli.scene_file import load_any, names_scene
from pocketgs.cli.terminal import Terminal
from pocketgs.cli.unposed_lines import unposed_lines
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import DEFAULT_MB, memory_bound
from pocketgs.scene.formats.activations import opacity_of
from pocketgs.scene.gaussians import SH_COEFFICIENTS, Gaussians
from pocketgs.sort_free.scene import SortFreeScene


def info(
    path: Annotated[Path | None, tyro.conf.Positional] = None,
    devices: bool = False,
    max_memory: int = DEFAULT_MB,
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Describe a capture, photographs or a scene, or list the devices to compute on.

    Args:
        path: A capture's folder or transforms.json, photographs, a video, a scene file (.ply, .pgs, .spz, .glb …), or a
            result folder.
        devices: List the GPUs and which engines can use them.
        max_memory: Megabytes that reading may take. A capture's photographs are reduced to fit; larger scenes are
            refused.
        reading: Options for reading a capture.
    """
    lines = []
    if path is None or names_scene(path):
        check_without_capture(reading, "its path")
    if path is not None:
        with memory_bound(max_memory):
            lines += _path_lines(path, reading)
    if devices:
        lines += _device_lines()
    if not lines:
        raise PocketGSError("info: found neither a path nor --devices, expected one of them")
    Terminal().say(*lines)


def _path_lines(path: Path, reading: CaptureOptions) -> list[str]:
    if not names_scene(path):
        capture = video_of(path)
        return unposed_lines(capture) if lacks_poses(capture) else _capture_lines(list_capture(capture, reading))
    scene = load_any(path)
    if isinstance(scene, SortFreeScene):
        return [*_scene_lines(scene.gaussians), _weights_line(scene)]
    return _scene_lines(scene)


def _device_lines() -> list[str]:
    # Loading the engines takes longer than everything else in this command.
    from pocketgs.gpu.adapters import adapters
    from pocketgs.splat.cpu.engine import CpuEngine

    return device_lines(adapters(), CpuEngine().threads)


def _capture_lines(listed: ListedCapture) -> list[str]:
    """Describe a capture, whose photographs need not fit in memory at full size."""
    shrink = listed.shrink_that_fits()
    capture = listed.load(shrink)
    cameras = [frame.camera for frame in capture.frames]
    sizes = sorted({f"{camera.width}x{camera.height}" for camera in cameras})
    focal = np.median([camera.fx for camera in cameras])
    extras = {
        "alpha": sum(frame.alpha is not None for frame in capture.frames),
        "mask": sum(frame.mask is not None for frame in capture.frames),
        "depth": sum(frame.depth is not None for frame in capture.frames),
    }
    with_extras = ", ".join(f"{count} with {name}" for name, count in extras.items() if count) or "colour only"
    centres = np.array([camera.centre for camera in cameras])
    span = " x ".join(f"{length:.3g}" for length in np.ptp(centres, axis=0))
    return [
        *capture_lines(capture),
        *_shrinking_lines(listed, shrink),
        f"images: {', '.join(sizes)}, median focal length {focal:.1f} pixels; {with_extras}",
        f"cameras lie in a box of {span} {'metres' if capture.metric else 'scene units'}",
        *(f"warning: {warning}" for warning in capture.warnings),
    ]


def _shrinking_lines(listed: ListedCapture, shrink: int) -> list[str]:
    if shrink == 1:
        return []
    outline = listed.outline()
    width, height = outline.largest
    full = f"at full size, up to {width}x{height}, they would take {outline.image_bytes / 1e6:,.0f} MB"
    return [f"photographs are read at 1/{shrink} of their size to fit in --max-memory: {full}"]


def _scene_lines(scene: Gaussians) -> list[str]:
    lines = [f"{len(scene):,} Gaussians, spherical harmonics of degree {scene.sh_degree}"]
    drawn = scene.select(scene.is_finite)
    if len(drawn) < len(scene):
        lines.append(f"{len(scene) - len(drawn):,} of them hold NaN or infinity, and are left out below")
    return [*lines, *(_statistics(drawn) if len(drawn) else [])]


def _statistics(scene: Gaussians) -> list[str]:
    """Lines on the places, opacities and sizes of finite Gaussians, at least one."""
    low, high = np.quantile(scene.means, [0.01, 0.99], axis=0)
    box = " x ".join(f"{length:.3g}" for length in high - low)
    opacities = opacity_of(scene.opacity_logits)
    # Medians of logarithms: standard deviations themselves may underflow.
    logarithms = scene.log_scales.astype(np.float64)
    largest = np.exp(np.median(logarithms.max(axis=1)))
    flatness = np.exp(-np.median(np.ptp(logarithms, axis=1)))
    return [
        f"98 % of the centres lie in a box of {box}",
        f"opacity: median {np.median(opacities):.3f}, {np.mean(opacities < 0.05):.1%} under 0.05",
        f"largest scale: median {largest:.3g}; smallest is {flatness:.2f} of it in the median",
    ]


def _weights_line(scene: SortFreeScene) -> str:
    numbers = zip(scene.form.numbers, np.exp(scene.log_shared), strict=True)
    parts = [f"unit {scene.unit:.3g}", *(f"{name} {value:.3g}" for name, value in numbers)]
    if scene.visibility_sh.shape[1]:
        parts.append(f"view-dependent weights of degree {SH_COEFFICIENTS.index(scene.visibility_sh.shape[1])}")
    return f"drawn without sorting, compositor {scene.form.name}: {', '.join(parts)}"
