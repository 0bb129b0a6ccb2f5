"""The scene: 3D Gaussians as a struct of arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.quaternions import of_unit_length

SH_COEFFICIENTS = (1, 4, 9, 16)
SH_DC = 0.28209479177387814
"""Spherical harmonic of degree 0, 1 / (2 √π): colour = 0.5 + SH_DC · sh[:, 0] at degree 0."""


@dataclass
class Gaussians:
    """N Gaussians in the parametrisation of the reference 3DGS `.ply`.

    Attributes:
        means: (N, 3) centres in world coordinates.
        log_scales: (N, 3) natural logarithms of the standard deviations along the Gaussian's axes.
        quaternions: (N, 4) w, x, y, z: rotation from the Gaussian's axes to the world, of any length; of length 0, the
            identity.
        opacity_logits: (N,) opacity = 1 / (1 + exp(-logit)).
        sh: (N, K, 3) spherical-harmonics coefficients of RGB, K = 1, 4, 9 or 16 for degree 0 to 3.

    All arrays are float32 and contiguous. NaN and infinity are allowed, since training may diverge: engines do not draw
    Gaussians that contain them. But infinite opacity logits are opacities of 0 and 1, and a scale of 0 has a
    logarithm of minus infinity.

    Raises:
        PocketGSError: an attribute is not an array of real numbers, or the shapes disagree.
    """

    means: np.ndarray
    log_scales: np.ndarray
    quaternions: np.ndarray
    opacity_logits: np.ndarray
    sh: np.ndarray

    def __post_init__(self) -> None:
        for name in PARAMETERS:
            setattr(self, name, _float32(name, getattr(self, name)))
        if self.means.ndim != 2:
            raise PocketGSError(f"Gaussians: means has shape {self.means.shape}, expected (N, 3)")
        count = len(self.means)
        expected = {"means": (3,), "log_scales": (3,), "quaternions": (4,), "opacity_logits": ()}
        for name, tail in expected.items():
            shape = getattr(self, name).shape
            if shape != (count, *tail):
                raise PocketGSError(f"Gaussians: {name} has shape {shape}, expected {(count, *tail)}")
        if self.sh.ndim != 3 or self.sh.shape[1] not in SH_COEFFICIENTS or self.sh.shape[::2] != (count, 3):
            raise PocketGSError(f"Gaussians: sh has shape {self.sh.shape}, expected ({count}, 1|4|9|16, 3)")

    def __len__(self) -> int:
        return len(self.means)

    @property
    def scales(self) -> np.ndarray:
        """(N, 3) standard deviations in scene units."""
        return np.exp(self.log_scales)

    @property
    def opacities(self) -> np.ndarray:
        """(N,) opacities in (0, 1)."""
        with np.errstate(over="ignore"):  # to infinity, which gives 0
            return 1.0 / (1.0 + np.exp(-self.opacity_logits))

    @property
    def unit_quaternions(self) -> np.ndarray:
        """(N, 4) quaternions of length 1; the identity where the length is 0, NaN where it is not finite."""
        return of_unit_length(self.quaternions)

    @property
    def is_finite(self) -> np.ndarray:
        """(N,) whether all numbers are finite, but for opacity logits: infinite ones are opacities of 0 and 1."""
        finite = ~np.isnan(self.opacity_logits)
        for values in (self.means, self.log_scales, self.quaternions, self.sh):
            finite &= np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
        return np.asarray(finite)

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0 to 3."""
        return SH_COEFFICIENTS.index(self.sh.shape[1])

    def select(self, keep: np.ndarray) -> Gaussians:
        """The Gaussians selected by a boolean mask or an index array."""
        return Gaussians(
            self.means[keep], self.log_scales[keep], self.quaternions[keep], self.opacity_logits[keep], self.sh[keep]
        )

    def save(self, path: str | Path) -> None:
        """Write the scene atomically. The suffix selects the format; `.ply` is lossless.

        Raises:
            PocketGSError: the suffix is unknown, the format cannot hold the scene, or the file cannot be written.
        """
        from pocketgs.scene.formats import write_scene

        write_scene(Path(path), self)

    @staticmethod
    def load(path: str | Path) -> Gaussians:
        """Read a scene in any format: `.pgs`, `.ply`, `.compressed.ply`, `.spz`, `.sog`, `.splat`, `.glb` or `.gltf`.

        Raises:
            PocketGSError: the suffix is unknown, or the file is missing, broken, or holds no Gaussians.
        """
        from pocketgs.scene.formats import read_scene

        return read_scene(Path(path))


def _float32(name: str, values: object) -> np.ndarray:
    """Convert to float32; numbers beyond its range become infinite."""
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "fiub":
            raise TypeError(f"of type {array.dtype}")
        with np.errstate(over="ignore"):
            return np.ascontiguousarray(array, dtype=np.float32)
    except (TypeError, ValueError) as error:
        raise PocketGSError(f"Gaussians: {name} is not an array of real numbers ({error})") from error


PARAMETERS = tuple(field.name for field in fields(Gaussians))


def concatenate(parts: list[Gaussians]) -> Gaussians:
    """Concatenate scenes, which must have the same degree of spherical harmonics."""
    return Gaussians(
        np.concatenate([part.means for part in parts]),
        np.concatenate([part.log_scales for part in parts]),
        np.concatenate([part.quaternions for part in parts]),
        np.concatenate([part.opacity_logits for part in parts]),
        np.concatenate([part.sh for part in parts]),
    )
