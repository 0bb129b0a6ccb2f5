"""Conversion between the rasterizer's outputs and composited channels, in both directions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.quaternions import rotation_matrices
from pocketgs.splat.backend import Parameters


@dataclass(frozen=True)
class Images:
    """Rendered outputs per pixel; None for those not requested."""

    rgb: np.ndarray | None
    depth: np.ndarray | None
    normals: np.ndarray | None
    features: np.ndarray | None


@dataclass(frozen=True)
class Channels:
    """The assignment of outputs to channels of the composited image.

    Attributes:
        values: (N, C) of each Gaussian, without colours, which engines compute themselves.
        count: number of channels, including colours.
        rgb, depth, normals, features: their slices of the channels, or None.
        facing: the Gaussians' normals, if requested.
    """

    values: np.ndarray
    count: int
    rgb: slice | None
    depth: slice | None
    normals: slice | None
    features: slice | None
    facing: _Normals | None

    def images(self, image: np.ndarray, transmittance: np.ndarray, background: np.ndarray) -> Images:
        """Convert (C, H, W) composited channels to outputs."""

        def pick(channels: slice | None) -> np.ndarray | None:
            return None if channels is None else np.moveaxis(image[channels], 0, 2).copy()

        rgb = pick(self.rgb)
        if rgb is not None:
            rgb += transmittance[..., None] * background
        depth = None if self.depth is None else _divided(image[self.depth][0], 1.0 - transmittance)
        return Images(rgb, depth, pick(self.normals), pick(self.features))

    def d_images(
        self,
        given: Mapping[str, np.ndarray | None],
        image: np.ndarray,
        transmittance: np.ndarray,
        background: np.ndarray,
        dtype: type[np.floating[Any]],
    ) -> tuple[np.ndarray, np.ndarray]:
        """Gradients with respect to the composited channels, (C, H, W), and to the transmittance, (H, W).

        Raises:
            PocketGSError: a gradient belongs to an output that was not requested, or has another shape.
        """
        shape = transmittance.shape
        d_image, d_transmittance = np.zeros((self.count, *shape), dtype), np.zeros(shape, dtype)
        for name, gradient in given.items():
            if gradient is None:
                continue
            if name == "alpha":
                d_transmittance -= _checked_gradient(name, gradient, shape)
                continue
            channels: slice | None = getattr(self, name)
            if channels is None:
                raise PocketGSError(f"rasterizer: found a gradient of {name}, which was not among the outputs")
            if name == "depth":
                alpha = 1.0 - transmittance
                d_sum = _divided(_checked_gradient(name, gradient, shape).astype(dtype), alpha)
                d_image[channels] = d_sum
                d_transmittance += d_sum * _divided(image[channels][0], alpha)
            else:
                sized = _checked_gradient(name, gradient, (*shape, channels.stop - channels.start))
                d_image[channels] = np.moveaxis(sized, 2, 0)
        if given["rgb"] is not None:
            d_transmittance += given["rgb"] @ background
        return d_image, d_transmittance

    def d_means(self, d_channels: np.ndarray, means: np.ndarray, camera: Camera) -> np.ndarray:
        """(N, 3) gradient with respect to the (N, 3) means through their depths."""
        if self.depth is None:
            return np.zeros((len(d_channels), 3), d_channels.dtype)
        ways: np.ndarray = camera.forward
        if camera.lens.model == "fisheye":
            with np.errstate(all="ignore"):
                ways = (means - camera.centre) / camera.depths(means)[:, None]
        d_depths = d_channels[:, self.depth]
        return np.where(d_depths != 0.0, d_depths * ways.astype(d_channels.dtype), 0.0).astype(d_channels.dtype)

    def d_rotations(self, d_channels: np.ndarray) -> np.ndarray:
        """(N, 3) gradient with respect to the rotations, in their tangent spaces, through the normals."""
        if self.normals is None or self.facing is None:
            return np.zeros((len(d_channels), 3), d_channels.dtype)
        return self.facing.d_rotations(d_channels[:, self.normals]).astype(d_channels.dtype)


@dataclass(frozen=True)
class _Normals:
    """Normals of Gaussians: their shortest axes, turned towards the camera.

    Attributes:
        axes: (N, 3, 3) rotations from the Gaussians' axes to the world's.
        shortest: (N,) index of the shortest axis.
        signs: (N,) 1, or -1 if that axis points away from the camera.
    """

    axes: np.ndarray
    shortest: np.ndarray
    signs: np.ndarray

    @staticmethod
    def of(parameters: Parameters, camera: Camera) -> _Normals:
        axes = rotation_matrices(parameters.quaternions)
        shortest = np.argmin(parameters.log_scales, axis=1)
        with np.errstate(all="ignore"):
            away = np.einsum("nij,ni->nj", axes, parameters.means - camera.centre)
        signs = np.where(away[np.arange(len(shortest)), shortest] > 0.0, -1.0, 1.0)
        return _Normals(axes, shortest, signs)

    @property
    def vectors(self) -> np.ndarray:
        """(N, 3) in the world."""
        return np.asarray(self.axes[np.arange(len(self.shortest)), :, self.shortest] * self.signs[:, None])

    def d_rotations(self, d_normals: np.ndarray) -> np.ndarray:
        """(N, 3) gradient with respect to the rotations: R ← R exp([δ]×) moves column k of R by R (δ × e_k)."""
        own = np.einsum("nij,ni->nj", self.axes, d_normals) * self.signs[:, None]
        turned = np.cross(np.eye(3)[self.shortest], own)
        return np.where(np.any(d_normals != 0.0, axis=1, keepdims=True), turned, 0.0)


def channels_of(
    parameters: Parameters,
    camera: Camera,
    outputs: Sequence[str],
    features: np.ndarray | None,
    dtype: type[np.floating[Any]],
) -> Channels:
    """Assign channels to outputs.

    Raises:
        PocketGSError: the features do not have one row per Gaussian.
    """
    count = len(parameters.means)
    if ("features" in outputs) != (features is not None):
        raise PocketGSError("rasterizer: the output 'features' and the argument features belong together")
    columns: dict[str, np.ndarray] = {}
    normals = None
    if "depth" in outputs:
        with np.errstate(all="ignore"):
            columns["depth"] = camera.depths(parameters.means)[:, None]
    if "normals" in outputs:
        normals = _Normals.of(parameters, camera)
        columns["normals"] = normals.vectors
    if features is not None:
        columns["features"] = np.asarray(features)
        if columns["features"].ndim != 2 or len(features) != count:
            raise PocketGSError(f"rasterizer: features have shape {np.shape(features)}, expected ({count}, D)")
    places = {"rgb": slice(0, 3)} if "rgb" in outputs else {}
    end = 3 * len(places)
    for name, values in columns.items():
        places[name] = slice(end, end + values.shape[1])
        end += values.shape[1]
    with np.errstate(all="ignore"):
        rows = np.concatenate([np.zeros((count, 0)), *columns.values()], axis=1).astype(dtype)
    rgb, depth, normal, feature = (places.get(name) for name in ("rgb", "depth", "normals", "features"))
    return Channels(rows, end, rgb, depth, normal, feature, normals)


def _checked_gradient(name: str, gradient: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Check the gradient of an output.

    Raises:
        PocketGSError: its shape is not the output's.
    """
    if np.shape(gradient) != shape:
        raise PocketGSError(f"rasterizer: the gradient of {name} has shape {np.shape(gradient)}, expected {shape}")
    return np.asarray(gradient)


def _divided(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """The quotient, 0 where the denominator is 0."""
    return np.divide(numerator, denominator, out=np.zeros_like(numerator), where=denominator > 0.0)
