"""The reference's backend of the rasterizer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import PARAMETERS
from pocketgs.splat.backend import Composite, CompositeGradient, Contributions, Parameters, contributions_in_turn
from pocketgs.splat.reference.compositor import COMPOSITORS
from pocketgs.splat.reference.project import Projection, project, project_backward
from pocketgs.splat.reference.rasterize import Raster
from pocketgs.splat.reference.scene import Scene


@dataclass(frozen=True)
class _Tape:
    scene: Scene
    camera: Camera
    projection: Projection
    raster: Raster
    colours: int
    antialiased: bool


class ReferenceBackend:
    """See `pocketgs.splat.backend.Backend`."""

    dtype: type[np.floating[Any]] = np.float64

    def __init__(self, compositor: str = "over") -> None:
        self._compositor = COMPOSITORS[compositor]

    def forward(
        self,
        parameters: Parameters,
        camera: Camera,
        near: float,
        colours: bool,
        channels: np.ndarray,
        antialiased: bool = False,
    ) -> Composite:
        """Composite colours and channels."""
        scene = Scene(*(np.asarray(getattr(parameters, name), np.float64) for name in PARAMETERS))
        projection = project(scene, camera, near, antialiased)
        shown = 3 if colours else 0
        values = np.concatenate([projection.colours[:, :shown], channels], axis=1)
        projection = replace(projection, colours=values)
        raster = self._compositor.forward(projection, camera, np.zeros(values.shape[1]))
        visible = np.flatnonzero(projection.visible)
        tape = _Tape(
            scene=scene,
            camera=camera,
            projection=projection,
            raster=raster,
            colours=shown,
            antialiased=antialiased,
        )
        image = np.moveaxis(raster.image, 2, 0)
        return Composite(image, raster.transmittance, visible, projection.radii[visible], tape)

    def backward(
        self, composite: Composite, d_image: np.ndarray, d_transmittance: np.ndarray, absolute: bool
    ) -> CompositeGradient:
        """Convert gradients of images to gradients of Gaussians."""
        tape: _Tape = composite.tape
        found = self._compositor.backward(
            tape.projection, tape.camera, tape.raster, np.moveaxis(d_image, 0, 2), d_transmittance
        )
        d_colours = found.colours[:, :3] if tape.colours else np.zeros((len(found.means), 3))
        d_projection = replace(found, colours=d_colours)
        scene = project_backward(tape.scene, tape.camera, tape.projection, d_projection, tape.antialiased)
        return CompositeGradient(
            means=scene.means,
            log_scales=scene.log_scales,
            rotations=scene.rotations,
            opacity_logits=scene.opacity_logits,
            sh=scene.sh,
            channels=found.colours,
            centres=found.means,
            absolute_centres=found.absolute_means,
        )

    def inspect(self, composite: Composite) -> tuple[Contributions, np.ndarray]:
        """Contributions of each Gaussian, and the median depth."""
        assert self._compositor.inspect is not None
        return self._compositor.inspect(composite.tape.projection, composite.tape.camera)

    def contributions(self, parameters: Parameters, cameras: Iterable[Camera], near: float) -> Iterator[Contributions]:
        """Contributions of each Gaussian to each camera's image, in turn."""
        return contributions_in_turn(self, parameters, cameras, near)
