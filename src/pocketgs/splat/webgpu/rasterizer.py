"""The rasterizer's operations in compute shaders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.gpu.adapters import choose_adapter
from pocketgs.gpu.buffer_sizes import check_buffers
from pocketgs.gpu.device import shared_device
from pocketgs.gpu.executor import Executor
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.ellipse import half_sizes
from pocketgs.splat.parameters import ParameterLayout
from pocketgs.splat.rasterizer import Composite, CompositeGradient, Contributions, Parameters
from pocketgs.splat.webgpu.frame_values import view_values
from pocketgs.splat.webgpu.memory import GROWTH, MIN_INTERSECTIONS
from pocketgs.splat.webgpu.passes import Variant
from pocketgs.splat.webgpu.rasterizer_passes import CENTRE_WORDS, GROUP, describe_rasterizer
from pocketgs.splat.webgpu.scene_columns import to_columns

SPLAT_WORDS = 10
"""Of a splat in `common/splats.wgsl`: centre 2, depth, log2 of the opacity, exponents 3, colour 3."""


CULLED = 0xFFFFFFFF
"""The depth key of what is not drawn."""


@dataclass(frozen=True, eq=False)
class _Tape:
    """What an image was made from.

    Attributes:
        scene: the Gaussians.
        camera: from where.
        near: least depth of what is drawn.
        colours: whether the first group of channels is the Gaussians' colour.
        channels: number of channels, colour included.
        values: (N, 3 G) float32, the channels of each Gaussian, in whole groups.
    """

    scene: Gaussians
    camera: Camera
    near: float
    colours: bool
    channels: int
    values: np.ndarray

    @property
    def symbols(self) -> dict[str, int]:
        """The numbers that the passes follow from, but for the room for intersections."""
        return {
            "gaussians": len(self.scene),
            "capacity": len(self.scene),
            "coefficients": self.scene.sh.shape[1] if self.colours else 0,
            "width": self.camera.width,
            "height": self.camera.height,
            "channel_groups": self.values.shape[1] // GROUP,
            "colours": int(self.colours),
            "replay_depth": 0,
        }


class WebGpuBackend:
    """See `pocketgs.splat.rasterizer.Backend`.

    The GPU holds one image's lists at a time. Going back from an earlier image draws it again first.

    Args:
        gpu: part of the name of the GPU to use, or None for the best.
        compositor: how splats come together: "over" or "sum".

    Raises:
        PocketGSError: there is no such device, or it lacks something.
    """

    dtype: type[np.floating[Any]] = np.float32

    def __init__(self, gpu: str | None = None, compositor: str = "over") -> None:
        adapter = choose_adapter(gpu)
        variant = Variant(subgroups="subgroup" in adapter.features)
        device = shared_device(adapter, variant.features)
        self._executor = Executor(device, describe_rasterizer(variant.subgroups, compositor))
        self._largest = adapter.largest_buffer
        self._room = MIN_INTERSECTIONS
        self._shown: _Tape | None = None
        self._symbols: dict[str, int] = {}

    def forward(
        self,
        parameters: Parameters,
        camera: Camera,
        near: float,
        colours: bool,
        channels: np.ndarray,
        antialiased: bool = False,
    ) -> Composite:
        """Project → sort → bin → rasterize.

        Raises:
            PocketGSError: the camera is no pinhole, or anti-aliasing is asked for.
        """
        if antialiased:
            raise PocketGSError('anti-aliased rasterizing: not on WebGPU, expected the engine "cpu" or "reference"')
        scene = Gaussians(*(getattr(parameters, name) for name in PARAMETERS))
        shown = GROUP if colours else 0
        composited = shown + channels.shape[1]
        groups = max(-(-composited // GROUP), 1)
        values = np.zeros((len(scene), GROUP * groups), np.float32)
        values[:, shown:composited] = channels
        tape = _Tape(scene, camera, near, colours, composited, values)
        self._show(tape)
        pixels = self._executor.read("image", np.float32, 4 * groups * self._symbols["pixels"])
        planes = np.moveaxis(pixels.reshape(groups, camera.height, camera.width, 4), 3, 1)
        image = planes[:, :GROUP].reshape(GROUP * groups, camera.height, camera.width)[:composited]
        visible = self._visible()
        splats = self._executor.read("splats", np.float32, SPLAT_WORDS * len(scene)).reshape(-1, SPLAT_WORDS)[visible]
        return Composite(image, planes[0, GROUP].copy(), visible, half_sizes(splats[:, 3], splats[:, 4:7]), tape)

    def backward(
        self, composite: Composite, d_image: np.ndarray, d_transmittance: np.ndarray, absolute: bool
    ) -> CompositeGradient:
        """Rasterize backward → project backward."""
        tape: _Tape = composite.tape
        count, coefficients = tape.scene.sh.shape[:2]
        self._show(tape)
        sequence = "backward, absolute too" if absolute else "backward"
        self._reserve(sequence)
        self._submit(sequence, {"d_image": _packed(d_image, d_transmittance)})
        columns = self._symbols["columns"]
        gradients = self._executor.read("gradients", np.float32, columns * count).reshape(columns, count).T
        width = CENTRE_WORDS + tape.values.shape[1]
        rows = self._executor.read("channel_gradients", np.float32, width * count).reshape(count, width)
        layout = ParameterLayout(coefficients)
        d_sh = (
            gradients[:, layout.columns_of("sh")] if tape.colours else np.zeros((count, 3 * coefficients), np.float32)
        )
        return CompositeGradient(
            gradients[:, layout.columns_of("means")],
            gradients[:, layout.columns_of("log_scales")],
            gradients[:, layout.columns_of("quaternions")],
            gradients[:, layout.columns_of("opacity_logits")][:, 0],
            d_sh.reshape(count, coefficients, 3),
            rows[:, CENTRE_WORDS : CENTRE_WORDS + tape.channels],
            rows[:, :2],
            rows[:, 2:CENTRE_WORDS],
        )

    def inspect(self, composite: Composite) -> tuple[Contributions, np.ndarray]:
        """What every Gaussian adds to the image, and the median depth."""
        self._show(composite.tape)
        self._reserve("inspect")
        self._submit("inspect")
        count = len(composite.tape.scene)
        pixels, summed, largest, _ = self._executor.read("contributions", np.float32, 4 * count).reshape(count, 4).T
        depths = self._executor.read("median_depths", np.float32, self._symbols["pixels"])
        contributions = Contributions(pixels.astype(np.int32), largest.copy(), summed.copy())
        return contributions, depths.reshape(composite.transmittance.shape)

    def _show(self, tape: _Tape) -> None:
        """Draw an image, unless it is the one that was drawn last."""
        if tape is self._shown:
            return
        self._shown = None
        shape, sh = to_columns(tape.scene)
        content = {"shape": shape, "sh": sh if tape.colours else sh[:0], "channels": tape.values}
        while True:
            symbols = {**tape.symbols, "intersections": self._room}
            self._symbols = self._executor.description.symbols(symbols)
            self._reserve("forward")
            self._executor.write_uniform("view", view_values(tape.camera, (0.0, 0.0, 0.0), tape.near, self._symbols))
            self._executor.clear("cluster_bounds")
            self._submit("forward", {**content, "status": np.zeros(3, np.uint32)})
            _, halted, needed = self._executor.read("status", np.uint32, 3)
            if not halted:
                self._shown = tape
                # What follows holds something for each intersection that there is.
                self._symbols["intersections"] = int(needed)
                return
            self._room = int(needed * GROWTH)

    def _submit(self, sequence: str, content: Mapping[str, np.ndarray] = MappingProxyType({})) -> None:
        """Write to some buffers, then run a sequence."""
        for name, values in content.items():
            self._executor.write(name, values)
        self._executor.submit(sequence, self._symbols)

    def _reserve(self, sequence: str) -> None:
        """Make the buffers of a sequence, but for those that stand from the forward pass.

        Raises:
            PocketGSError: the device does not allow one as large.
        """
        description = self._executor.description
        standing = set() if sequence == "forward" else set(description.buffers_of(["forward"]))
        names = [name for name in description.buffers_of([sequence]) if name not in standing]
        sizes = description.sizes(self._symbols, names)
        check_buffers(sizes, self._largest, "fewer Gaussians, channels or pixels")
        self._executor.reserve(sizes)

    def _visible(self) -> np.ndarray:
        """(V,) int32, ascending: the Gaussians that are drawn."""
        in_view = int(self._executor.read("gaussian_count", np.uint32, 1)[0])
        keys = self._executor.read("depth_keys", np.uint32, in_view)
        order = self._executor.read("order", np.uint32, in_view)
        return np.sort(order[keys != CULLED]).astype(np.int32)


def _packed(d_image: np.ndarray, d_transmittance: np.ndarray) -> np.ndarray:
    """(G, H, W, 4) float32: the gradient of each group's channels, and of the transmittance with the first."""
    channels, height, width = d_image.shape
    groups = max(-(-channels // GROUP), 1)
    planes = np.zeros((GROUP * groups, height, width), np.float32)
    planes[:channels] = d_image
    packed = np.zeros((groups, height, width, 4), np.float32)
    packed[..., :GROUP] = np.moveaxis(planes.reshape(groups, GROUP, height, width), 1, 3)
    packed[0, ..., GROUP] = d_transmittance
    return packed
