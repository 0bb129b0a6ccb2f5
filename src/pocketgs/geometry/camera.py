"""The camera: intrinsics in pixels, a lens and a rigid pose."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pocketgs.errors import PocketGSError, short
from pocketgs.geometry import lens as lenses
from pocketgs.geometry.lens import PINHOLE, Lens

MAX_SIDE = 2**24
"""Maximum image side in pixels; the product of two such sides still fits in common integer types."""


@dataclass(frozen=True)
class Camera:
    """A camera in OpenCV axes (x right, y down, z forward).

    A world point X projects to pixel (fx·u + cx, fy·v + cy), where the lens maps (x, y, z, 1) = world_to_camera @ (X,
    1) to (u, v); for a pinhole camera (x/z, y/z). The centre of the top left pixel is at (0.5, 0.5).

    Attributes:
        width, height: image size in pixels.
        fx, fy, cx, cy: focal lengths and principal point in pixels of that image.
        world_to_camera: (4, 4) float64 rigid transform.
        lens: the lens model; see `pocketgs.geometry.lens`.

    Raises:
        PocketGSError: a size is not a whole number from 1 to MAX_SIDE, a focal length is not positive, a number is not
            finite, or the pose is not rigid.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    world_to_camera: np.ndarray
    lens: Lens = PINHOLE

    def __post_init__(self) -> None:
        try:
            pose = np.array(self.world_to_camera, dtype=np.float64)
            intrinsics = np.array([self.fx, self.fy, self.cx, self.cy], dtype=np.float64)
        except (TypeError, ValueError, OverflowError) as error:
            raise PocketGSError(f"camera: its pose or its intrinsics are not numbers ({error})") from error
        object.__setattr__(self, "world_to_camera", pose)
        sides = (self.width, self.height)
        if not all(isinstance(side, int | np.integer) and 1 <= side <= MAX_SIDE for side in sides):
            found = "x".join(map(short, sides))
            raise PocketGSError(f"camera: image size {found}, expected whole numbers from 1 to {MAX_SIDE}")
        if intrinsics.shape != (4,) or not np.all(np.isfinite(intrinsics)) or self.fx <= 0 or self.fy <= 0:
            found = ", ".join(map(short, (self.fx, self.fy, self.cx, self.cy)))
            raise PocketGSError(f"camera: fx, fy, cx, cy = {found}, expected finite and positive focal lengths")
        if pose.shape != (4, 4) or not np.all(np.isfinite(pose)):
            raise PocketGSError("camera: the pose is not a 4x4 matrix of finite numbers")
        rotation = pose[:3, :3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
            raise PocketGSError("camera: the pose's upper left 3x3 block is not a rotation")
        if np.abs(pose[3] - (0.0, 0.0, 0.0, 1.0)).max() > 1e-3:
            found = ", ".join(map(short, pose[3].tolist()))
            raise PocketGSError(f"camera: the pose's last row is ({found}), expected (0, 0, 0, 1): is it transposed?")
        if not isinstance(self.lens, Lens):
            raise PocketGSError(f"camera: lens is {type(self.lens).__name__}, expected a Lens")

    @property
    def is_pinhole(self) -> bool:
        """Whether the lens has no distortion."""
        return not self.lens.distorts

    @property
    def camera_to_world(self) -> np.ndarray:
        """(4, 4) inverse of `world_to_camera`."""
        rotation, translation = self.world_to_camera[:3, :3], self.world_to_camera[:3, 3]
        inverse = np.eye(4)
        inverse[:3, :3] = rotation.T
        inverse[:3, 3] = -rotation.T @ translation
        return inverse

    @property
    def centre(self) -> np.ndarray:
        """(3,) position of the camera in the world."""
        return self.camera_to_world[:3, 3]

    @property
    def forward(self) -> np.ndarray:
        """(3,) unit vector along the optical axis, in the world."""
        return self.world_to_camera[2, :3]

    @property
    def intrinsic_matrix(self) -> np.ndarray:
        """(3, 3) matrix K, with pixel centres at + 0.5."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def grid_shape(self, cells: int) -> tuple[int, int]:
        """Rows and columns of a grid of about square cells over the image, with `cells` along its longer side."""
        side = max(self.width, self.height) / cells
        return max(1, round(self.height / side)), max(1, round(self.width / side))

    def resized(self, width: int, height: int) -> Camera:
        """The same view in an image of another size."""
        across, down = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * across,
            fy=self.fy * down,
            cx=self.cx * across,
            cy=self.cy * down,
        )

    def cropped(self, left: int, top: int, width: int, height: int) -> Camera:
        """The camera of the crop whose top left pixel is (left, top)."""
        return replace(self, width=width, height=height, cx=self.cx - left, cy=self.cy - top)

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project world points.

        Args:
            points: (N, 3).

        Returns:
            (N, 2) pixel coordinates and (N,) depths, see `depths`. Pixels of points at depth <= 0 are undefined: check
            the depths first. Points that a lens does not show have depth 0.
        """
        local = points @ self.world_to_camera[:3, :3].T + self.world_to_camera[:3, 3]
        if not self.is_pinhole:
            seen = lenses.shown(self.lens, local)
            ahead = np.where(seen[:, None], local, (0.0, 0.0, 1.0))
            pixels = lenses.project(self.lens, ahead) * (self.fx, self.fy) + (self.cx, self.cy)
            return pixels, np.where(seen, lenses.depths(self.lens, local), 0.0)
        depth = local[:, 2]
        safe = np.where(np.abs(depth) > 1e-12, depth, 1e-12)
        pixels = np.stack([self.fx * local[:, 0] / safe + self.cx, self.fy * local[:, 1] / safe + self.cy], axis=1)
        return pixels, depth

    def contains(self, pixels: np.ndarray) -> np.ndarray:
        """(N,) bool: whether (N, 2) pixel coordinates, with pixel centres at + 0.5, lie in the image.

        The left and top edges, at 0, belong to it, the right and bottom ones do not: rounded down, the coordinates are
        columns and rows.
        """
        inside: np.ndarray = np.all((pixels >= 0) & (pixels < (self.width, self.height)), axis=1)
        return inside

    def shows(self, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """(N,) bool: whether points that `project` has projected lie in front of the camera and in the image.

        Args:
            pixels: (N, 2).
            depth: (N,).
        """
        return (depth > 0) & self.contains(pixels)

    def depths(self, points: np.ndarray) -> np.ndarray:
        """(N,) depths of (N, 3) world points: along the optical axis, or for a fisheye distances from the camera."""
        if self.lens.model == "fisheye":
            return np.asarray(np.linalg.norm(points - self.centre.astype(points.dtype), axis=1))
        return np.asarray((points @ self.forward[:, None])[:, 0] + self.world_to_camera[2, 3])

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """(N, 3) world directions of (N, 2) pixel coordinates.

        They have length 1 along the optical axis, or for a fisheye length 1: the camera's centre plus a ray times a
        depth is a point. An orthographic camera's rays are parallel, and do not start at its centre.
        """
        x = (pixels[:, 0] - self.cx) / self.fx
        y = (pixels[:, 1] - self.cy) / self.fy
        return lenses.unproject(self.lens, np.stack([x, y], axis=1)) @ self.world_to_camera[:3, :3]


def look_at(eye: np.ndarray, target: np.ndarray, up: np.ndarray) -> np.ndarray:
    """(4, 4) world_to_camera of a camera at `eye` that looks at `target` with `up` pointing up in the image.

    Raises:
        PocketGSError: the eye is the target, or it looks along `up`.
    """
    forward = np.asarray(target, dtype=np.float64) - eye
    right = np.cross(forward, up)
    if not np.any(forward):
        raise PocketGSError("look at: the eye is where the target is")
    if np.linalg.norm(right) <= 1e-12 * np.linalg.norm(forward) * np.linalg.norm(up):
        raise PocketGSError("look at: up is parallel to the view, expected another direction")
    forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = -rotation @ eye
    return pose
