"""Drawing images with the passes, whatever holds the scene and makes room for the lists of tiles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.gpu.executor import Executor
from pocketgs.gpu.sizes import Symbols
from pocketgs.scene.background import Background, checked_background
from pocketgs.splat.engine import Rendering
from pocketgs.splat.webgpu.frame_values import view_values
from pocketgs.splat.webgpu.lenses import lens_values

Draw: TypeAlias = Callable[[str, Camera, Background], np.ndarray]
"""Runs a sequence: gives (H, W, 4) float32, colour and how much of the background shows."""

Room = TypeVar("Room")


def rendered(draw: Draw, camera: Camera, background: Background, depth: bool) -> Rendering:
    """Render a view.

    Args:
        draw: draws an image.
        camera: the view to draw.
        background: RGB behind the scene.
        depth: whether to compute the depth.

    Raises:
        PocketGSError: the background is no colour, or `draw` fails.
    """
    image = draw("render", camera, checked_background(background))
    alpha, expected_depth = 1.0 - image[..., 3], None
    if depth:
        total = draw("render depth", camera, (0.0, 0.0, 0.0))[..., 0]
        expected_depth = np.divide(total, alpha, out=np.zeros_like(alpha), where=alpha > 0.0)
    return Rendering(np.ascontiguousarray(image[..., :3]), alpha, expected_depth)


def draw_once(
    executor: Executor, sequence: str, camera: Camera, background: Background, near: float, symbols: Symbols
) -> tuple[np.ndarray, int]:
    """Draw an image if there is room for its tiles' lists.

    Args:
        executor: holds the scene.
        sequence: name of the one to run.
        camera: the view to draw.
        background: RGB behind the scene.
        near: minimum depth of drawn Gaussians.
        symbols: of the image, see `Description.symbols`.

    Returns:
        (H, W, 4) float32, colour and how much of the background shows; and the intersections that there was too little
        room for, 0 if there was enough.
    """
    write_camera(executor, camera, background, near, symbols)
    executor.submit(sequence, symbols)
    pixels = executor.read("image", np.float32, 4 * symbols["pixels"])
    _, halted, needed = executor.read("status", np.uint32, 3)
    return pixels.reshape(camera.height, camera.width, 4), int(needed) if halted else 0


def make_room_for(make_room: Callable[[int], Room], wanted: int, needed: int) -> Room:
    """Make room for the wanted number of intersections or, if that does not fit into memory, for the needed number.

    Args:
        make_room: for a number of intersections.
        wanted: with a reserve, so that the next image probably fits too.
        needed: at least these.

    Returns:
        What `make_room` returns.

    Raises:
        PocketGSError: the needed intersections do not fit either.
    """
    try:
        return make_room(wanted)
    except PocketGSError:
        return make_room(needed)


def write_camera(
    executor: Executor,
    camera: Camera,
    background: Background,
    near: float,
    symbols: Symbols,
    of_step: Mapping[str, ArrayLike] = MappingProxyType({}),
) -> None:
    """Set the uniform buffers of an image.

    Args:
        executor: holds them.
        camera: the view to draw.
        background: RGB behind the scene.
        near: minimum depth of drawn Gaussians.
        symbols: see `view_values`.
        of_step: from `step_values`, for a training step.
    """
    executor.write_uniform("view", {**view_values(camera, background, near, symbols), **of_step})
    if "lens" in executor.description.uniforms:  # not where splats come projected
        executor.write_uniform("lens", lens_values(camera))
