"""Cameras, photographs and clouds as the page's modules take them."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.prior.poses.structure import StructureSettings
from pocketgs.prior.prior import PriorSettings
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.splat.webgpu.scene_columns import to_columns

TYPED = """
    const framesOf = (frames) => frames.map(({rgba, mask, depth, ...frame}) => ({
        ...frame,
        rgba: Uint8ClampedArray.from(rgba),
        mask: mask && Uint8ClampedArray.from(mask),
        depth: depth && Float32Array.from(depth),
    }));
    const cloudOf = ({positions, ...others}) => ({
        positions: Float64Array.from(positions),
        ...Object.fromEntries(Object.entries(others).map(([name, values]) => [name, Float32Array.from(values)])),
    });
"""
"""Functions for scripts: JSON has no typed arrays."""


OPEN_DEVICE = """
    const { BUFFER_LIMITS, openDevice } = await import(new URL("../gpu/device.js", location.href));
    const device = await openDevice(BUFFER_LIMITS);
    const complaints = [];
    device.addEventListener("uncapturederror", ({ error }) => complaints.push(error.message));
"""
"""Opens a GPU for a script, and collects its complaints."""


OPEN_FINDER = (
    OPEN_DEVICE
    + """
    const { FeatureFinder } = await import(new URL("prior/features/finder.js", location.href));
    const passes = await (await fetch("features_passes.json")).json();
    const finder = await FeatureFinder.open(device, passes, settings.prior.features);
"""
)
"""Opens the GPU, and what finds features on it."""


WITHOUT_FEATURES = PriorSettings(structure=StructureSettings(bundle=False, fewest_points=10**9), exposure="off")
"""The prior as the page has it."""


def plain(camera: Camera) -> dict[str, Any]:
    return {**asdict(camera), "world_to_camera": camera.world_to_camera.reshape(-1).tolist(), "lens": None}


def plain_frames(frames: Sequence[Frame]) -> list[dict[str, Any]]:
    given = []
    for frame in frames:
        alpha = np.full((*frame.image.shape[:2], 1), 255, np.uint8) if frame.alpha is None else frame.alpha[..., None]
        rgba = np.concatenate([frame.image, alpha], axis=2).reshape(-1).tolist()
        camera, transparent = plain(frame.camera), frame.alpha is not None
        mask = None if frame.mask is None else (255 * frame.mask.astype(int)).reshape(-1).tolist()
        depth = None if frame.depth is None else frame.depth.reshape(-1).tolist()
        own = {"name": frame.name, "camera": camera, "rgba": rgba, "hasAlpha": transparent}
        given.append({**own, "mask": mask, "depth": depth})
    return given


def plain_cloud(cloud: PointCloud) -> dict[str, list[float]]:
    arrays = {"positions": cloud.positions, "colours": cloud.colours, "directions": cloud.directions}
    return {name: array.reshape(-1).tolist() for name, array in arrays.items() if array is not None}


SCENE = """
    const {GaussianColumns} = await import(new URL("../page/scene/gaussian_columns.js", location.href));
    const scene = new GaussianColumns(given.count, given.coefficients);
    const bytes = (text) => Uint8Array.from(atob(text), (character) => character.charCodeAt(0)).buffer;
    scene.shape.set(new Float32Array(bytes(given.shape)));
    scene.sh.set(new Float32Array(bytes(given.sh)));
"""
"""Makes `scene` from what `plain_scene` gives."""


def plain_scene(scene: Gaussians) -> dict[str, Any]:
    shape, sh = (base64.b64encode(np.float32(part).tobytes()).decode() for part in to_columns(scene))
    return {"count": len(scene), "coefficients": scene.sh.shape[1], "shape": shape, "sh": sh}
