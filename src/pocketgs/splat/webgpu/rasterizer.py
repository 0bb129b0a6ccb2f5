"""The rasterizer's operations in compute shaders."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.backend import Composite, CompositeGradient, Contributions, Parameters
from pocketgs.splat.constants import CULLED
from pocketgs.splat.diverged import suspects, without_diverged
from pocketgs.splat.ellipse import half_sizes
from pocketgs.splat.parameters import ParameterLayout
from pocketgs.splat.webgpu.channels import in_groups, packed, read_channel_gradients, read_image
from pocketgs.splat.webgpu.image_lists import ImageLists
from pocketgs.splat.webgpu.layout import CENTRE_WORDS, SPLAT_WORDS
from pocketgs.splat.webgpu.lenses import lens_symbols
from pocketgs.splat.webgpu.rasterizer_passes import GROUP, backward_sequence, describe_rasterizer
from pocketgs.splat.webgpu.scene_columns import to_columns


@dataclass(frozen=True, eq=False)
class _Tape:
    """Inputs of an image.

    Attributes:
        scene: the Gaussians.
        camera: the view to draw.
        near: minimum depth of drawn Gaussians.
        colours: whether the first group of channels is the Gaussians' colour.
        channels: number of channels, colour included.
        values: (N, 3 G) float32, the channels of each Gaussian, in whole groups.
        antialiased: whether Gaussians smaller than a pixel fade.
    """

    scene: Gaussians
    camera: Camera
    near: float
    colours: bool
    channels: int
    values: np.ndarray
    antialiased: bool

    @property
    def symbols(self) -> dict[str, int]:
        """Numbers that `Description.symbols` needs, without "intersections"."""
        return {
            "gaussians": len(self.scene),
            "capacity": len(self.scene),
            "coefficients": self.scene.sh.shape[1] if self.colours else 0,
            "width": self.camera.width,
            "height": self.camera.height,
            "channel_groups": self.values.shape[1] // GROUP,
            "colours": int(self.colours),
            "antialiased": int(self.antialiased),
            "replay_depth": 0,
            **lens_symbols(self.camera),
        }


class WebGpuBackend:
    """See `pocketgs.splat.backend.Backend`.

    The GPU holds one image's lists at a time: threads take turns. Going back from an earlier image draws it again
    first.

    Args:
        gpu: part of the name of the GPU to use, or None for the best.
        compositor: how splats come together: "over" or "sum".

    Raises:
        PocketGSError: there is no such device, or it lacks something.
    """

    dtype: type[np.floating[Any]] = np.float32

    def __init__(self, gpu: str | None = None, compositor: str = "over") -> None:
        self._lists = ImageLists(gpu, partial(describe_rasterizer, compositor=compositor))

    def forward(
        self,
        parameters: Parameters,
        camera: Camera,
        near: float,
        colours: bool,
        channels: np.ndarray,
        antialiased: bool = False,
    ) -> Composite:
        """Project → sort → bin → rasterize."""
        scene = Gaussians(*(getattr(parameters, name) for name in PARAMETERS))
        if not colours:
            scene = without_diverged(scene, suspects(scene), camera)
        shown = GROUP if colours else 0
        composited = shown + channels.shape[1]
        values = in_groups(channels, first=shown)
        tape = _Tape(
            scene=scene,
            camera=camera,
            near=near,
            colours=colours,
            channels=composited,
            values=values,
            antialiased=antialiased,
        )
        words = SPLAT_WORDS["f32"]
        with self._lists.lock:
            self._show(tape)
            image, transmittance = read_image(self._lists, composited, camera.width, camera.height)
            visible = self._visible()
            splats = self._lists.read("splats", np.float32, words * len(scene)).reshape(-1, words)[visible]
        return Composite(image, transmittance, visible, half_sizes(splats[:, 3], splats[:, 4:7]), tape)

    def backward(
        self, composite: Composite, d_image: np.ndarray, d_transmittance: np.ndarray, absolute: bool
    ) -> CompositeGradient:
        """Rasterize backward → project backward."""
        tape: _Tape = composite.tape
        count, coefficients = tape.scene.sh.shape[:2]
        with self._lists.lock:
            self._show(tape)
            self._lists.run(backward_sequence(absolute), {"d_image": packed(d_image, d_transmittance)})
            columns = self._lists.symbols["columns"]
            gradients = self._lists.read("gradients", np.float32, columns * count).reshape(columns, count).T
            rows = read_channel_gradients(self._lists, count)
        layout = ParameterLayout(coefficients)
        d_sh = (
            gradients[:, layout.columns_of("sh")] if tape.colours else np.zeros((count, 3 * coefficients), np.float32)
        )
        return CompositeGradient(
            means=gradients[:, layout.columns_of("means")],
            log_scales=gradients[:, layout.columns_of("log_scales")],
            rotations=gradients[:, layout.columns_of("quaternions")],
            opacity_logits=gradients[:, layout.columns_of("opacity_logits")][:, 0],
            sh=d_sh.reshape(count, coefficients, 3),
            channels=rows[:, CENTRE_WORDS : CENTRE_WORDS + tape.channels],
            centres=rows[:, :2],
            absolute_centres=rows[:, 2:CENTRE_WORDS],
        )

    def inspect(self, composite: Composite) -> tuple[Contributions, np.ndarray]:
        """Contributions of each Gaussian, and the median depth."""
        with self._lists.lock:
            self._show(composite.tape)
            contributions = self._inspected(len(composite.tape.scene))
            depths = self._lists.read("median_depths", np.float32, self._lists.symbols["pixels"])
        return contributions, depths.reshape(composite.transmittance.shape)

    def contributions(self, parameters: Parameters, cameras: Iterable[Camera], near: float) -> Iterator[Contributions]:
        """Contributions of each Gaussian to each camera's image, in turn; no image is read back."""
        scene = Gaussians(*(getattr(parameters, name) for name in PARAMETERS))
        values = in_groups(np.empty((len(scene), 0), np.float32))
        content, rows = _content(scene, False, values), suspects(scene)
        for camera in cameras:
            if len(rows) > 0:
                content = _content(without_diverged(scene, rows, camera), False, values)
            tape = _Tape(
                scene=scene, camera=camera, near=near, colours=False, channels=0, values=values, antialiased=False
            )
            with self._lists.lock:
                self._lists.draw(tape, tape.symbols, camera, near, content)
                found = self._inspected(len(scene))
            yield found

    def _inspected(self, count: int) -> Contributions:
        """Contributions of `count` Gaussians to the image that was drawn last."""
        self._lists.run("inspect")
        pixels, summed, largest, _ = self._lists.read("contributions", np.float32, 4 * count).reshape(count, 4).T
        return Contributions(pixels=pixels.astype(np.int32), largest=largest.copy(), summed=summed.copy())

    def _show(self, tape: _Tape) -> None:
        """Draw an image, unless it is the one that was drawn last."""
        if self._lists.holds(tape):
            return
        content = _content(tape.scene, tape.colours, tape.values)
        self._lists.draw(tape, tape.symbols, tape.camera, tape.near, content)

    def _visible(self) -> np.ndarray:
        """(V,) int32, ascending: the Gaussians that are drawn."""
        in_view = int(self._lists.read("gaussian_count", np.uint32, 1)[0])
        keys = self._lists.read("depth_keys", np.uint32, in_view)
        order = self._lists.read("order", np.uint32, in_view)
        return np.sort(order[keys != CULLED]).astype(np.int32)


def _content(scene: Gaussians, colours: bool, values: np.ndarray) -> dict[str, np.ndarray]:
    """What the buffers of an image hold, see `_Tape`; harmonics only if colours are drawn."""
    shape, sh = to_columns(scene)
    return {"shape": shape, "sh": sh if colours else sh[:0], "channels": values}
