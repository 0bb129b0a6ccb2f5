"""A small ring of cameras, and writers that lay it out in each capture format."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from capture.phone_layouts import WRITERS
from pocketgs.capture import Capture
from pocketgs.geometry.camera import Camera, look_at

WIDTH, HEIGHT, FOCAL = 16, 12, 20.0


@dataclass(repr=False)
class Ring:
    """Cameras on a circle that look at its centre, with a random image each and a few points."""

    cameras: list[Camera]
    images: list[np.ndarray]
    names: list[str]
    positions: np.ndarray
    colours: np.ndarray

    def write_images(self, folder: Path) -> None:
        for name, image in zip(self.names, self.images, strict=True):
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(image).save(path)

    def transforms(self, folder: str = "images") -> dict[str, Any]:
        """The ring as a transforms.json document: camera to world in OpenGL axes."""
        frames = []
        for name, camera in zip(self.names, self.cameras, strict=True):
            matrix = camera.camera_to_world * np.array([1, -1, -1, 1])
            frames.append({"file_path": f"{folder}/{name}", "transform_matrix": matrix.tolist()})
        return {"fl_x": FOCAL, "fl_y": FOCAL, "cx": 8.5, "cy": 6.5, "w": WIDTH, "h": HEIGHT, "frames": frames}

    def poses_bounds(self) -> np.ndarray:
        """The ring as LLFF's array: axes down, right, back; centre; height, width, focal; two bounds."""
        rows = []
        for camera in self.cameras:
            right, down, forward, centre = camera.camera_to_world[:3].T
            row = np.stack([down, right, -forward, centre, np.array([HEIGHT, WIDTH, FOCAL])], axis=1)
            rows.append([*row.ravel(), 1.0, 10.0])
        return np.array(rows)


@dataclass(repr=False)
class ColmapFiles:
    """A COLMAP model as bytes and as text, by file name."""

    binary: dict[str, bytes] = field(default_factory=dict)
    text: dict[str, str] = field(default_factory=dict)

    def write(self, folder: Path, encoding: str = "binary") -> None:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in self.binary.items() if encoding == "binary" else self.text.items():
            data = content if isinstance(content, bytes) else content.encode()
            (folder / f"{name}.{'bin' if encoding == 'binary' else 'txt'}").write_bytes(data)


@pytest.fixture(scope="session")
def ring() -> Ring:
    random = np.random.default_rng(0)
    cameras, images, names = [], [], []
    for index in range(10):
        angle = 2 * np.pi * index / 10
        eye = np.array([3 * np.cos(angle), 3 * np.sin(angle), 0.5 + 0.1 * index])
        pose = look_at(eye, np.zeros(3), np.array([0.0, 0.0, 1.0]))
        cameras.append(Camera(WIDTH, HEIGHT, FOCAL, FOCAL, 8.5, 6.5, pose))
        images.append(random.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8))
        names.append(f"view_{index:02d}.png")
    return Ring(cameras, images, names, random.normal(size=(7, 3)), random.integers(0, 256, (7, 3)))


@pytest.fixture(scope="session")
def colmap_files(ring: Ring) -> ColmapFiles:
    """The ring as COLMAP writes it, with the camera model PINHOLE and tracks of differing lengths."""
    files = ColmapFiles()
    parameters = (FOCAL, FOCAL, 8.5, 6.5)
    files.binary["cameras"] = struct.pack("<QiiQQ4d", 1, 3, 1, WIDTH, HEIGHT, *parameters)
    files.text["cameras"] = f"# comment\n3 PINHOLE {WIDTH} {HEIGHT} {' '.join(map(str, parameters))}\n"
    image_bytes, image_lines = [struct.pack("<Q", len(ring.names))], ["# comment"]
    for number, (name, camera) in enumerate(zip(ring.names, ring.cameras, strict=True)):
        x, y, z, w = Rotation.from_matrix(camera.world_to_camera[:3, :3]).as_quat()
        pose = (w, x, y, z, *camera.world_to_camera[:3, 3])
        # Every other image has no points, which COLMAP writes as an empty line.
        points = [(1.5, 2.5, 7)] * (number % 2)
        image_bytes.append(struct.pack("<I7dI", number, *pose, 3) + name.encode() + b"\0")
        image_bytes.append(struct.pack("<Q", len(points)) + b"".join(struct.pack("<ddQ", *point) for point in points))
        image_lines.append(" ".join(map(repr, map(float, pose))).join([f"{number} ", f" 3 {name}"]))
        image_lines.append(" ".join(f"{x} {y} {identity}" for x, y, identity in points))
    files.binary["images"] = b"".join(image_bytes)
    files.text["images"] = "\n".join(image_lines) + "\n"
    point_bytes, point_lines = [struct.pack("<Q", len(ring.positions))], ["# comment"]
    for number, (position, colour) in enumerate(zip(ring.positions, ring.colours, strict=True)):
        track = [(number, 0)] * (number % 3)
        point_bytes.append(struct.pack("<Q3d3BdQ", number, *position, *colour, 0.5, len(track)))
        point_bytes.append(b"".join(struct.pack("<II", *element) for element in track))
        values = [*map(repr, map(float, position)), *map(str, colour), "0.5", *(f"{a} {b}" for a, b in track)]
        point_lines.append(f"{number} " + " ".join(values))
    files.binary["points3D"] = b"".join(point_bytes)
    files.text["points3D"] = "\n".join(point_lines) + "\n"
    return files


@pytest.fixture
def write_transforms(ring: Ring, tmp_path: Path) -> Callable[..., Path]:
    """Writes the ring as a transforms.json, with top-level fields replaced, and returns the folder."""

    def write(**replaced: Any) -> Path:
        ring.write_images(tmp_path / "images")
        (tmp_path / "transforms.json").write_text(json.dumps({**ring.transforms(), **replaced}))
        return tmp_path

    return write


@pytest.fixture(scope="session")
def assert_same_cameras() -> Callable[[list[Camera], list[Camera]], None]:
    def check(found: list[Camera], expected: list[Camera]) -> None:
        assert len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(one.world_to_camera, other.world_to_camera, atol=1e-9)
            assert (one.width, one.height) == (other.width, other.height)
            np.testing.assert_allclose(one.intrinsic_matrix, other.intrinsic_matrix, rtol=1e-9)

    return check


@pytest.fixture(scope="session")
def written_phones(small_capture: Capture, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """`small_capture` in every phone app's layout, read-only, by format."""
    folders = {name: tmp_path_factory.mktemp("phone") / name for name in WRITERS}
    for name, write in WRITERS.items():
        write(small_capture, folders[name])
    return folders


@pytest.fixture
def copied_phone(written_phones: dict[str, Path], tmp_path: Path) -> Callable[[str], Path]:
    """A function that copies one of `written_phones`, for tests that modify it."""
    return lambda name: Path(shutil.copytree(written_phones[name], tmp_path / name))
