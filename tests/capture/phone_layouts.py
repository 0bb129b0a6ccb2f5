"""Writers of a ground-truth capture in phone apps' layouts, and comparison with what is read."""

from __future__ import annotations

import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import lzfse
import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from pocketgs.capture import Capture, Frame, open_capture
from pocketgs.metrics.evaluation import psnr

LOW, MEDIUM, HIGH = 0, 1, 2
TO_ARKIT = np.array([1.0, -1.0, -1.0])
"""Turns the axes x right, y down, z forward into ARKit's: x right, y up, z back."""


def in_order(capture: Capture) -> list[Frame]:
    return sorted(capture.frames, key=lambda frame: frame.name)


def depth_and_confidence(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """The depth in metres at half size, as LiDAR maps are smaller than images; left quarter of low confidence."""
    assert frame.depth is not None
    depth = frame.depth[1::2, 1::2]
    confidence = np.full(depth.shape, HIGH, np.uint8)
    confidence[:, depth.shape[1] // 2 :] = MEDIUM
    confidence[:, : depth.shape[1] // 4] = LOW
    return depth, confidence


def expected_depth(frame: Frame) -> np.ndarray:
    """What a reader makes of `depth_and_confidence` at the size of the image."""
    depth, confidence = depth_and_confidence(frame)
    return np.repeat(np.repeat(np.where(confidence > LOW, depth, 0), 2, axis=0), 2, axis=1)


def arkit_intrinsics(frame: Frame) -> np.ndarray:
    """The intrinsic matrix with a principal point that counts from the centre of the top left pixel."""
    matrix = frame.camera.intrinsic_matrix.copy()
    matrix[:2, 2] -= 0.5
    return matrix


def save_millimetres(depth: np.ndarray, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.round(depth * 1000).astype(np.uint16)).save(path)


def save(pixels: np.ndarray, path: Path, **options: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, **options)


def write_stray_scanner(capture: Capture, folder: Path) -> None:
    """The rotations in odometry.csv belong to OpenCV's camera axes, unlike those of the other apps."""
    folder.mkdir(parents=True)
    frames = in_order(capture)
    write_lossless_video(folder / "rgb.mp4", [frame.image for frame in frames])
    lines = ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
    for index, frame in enumerate(frames):
        to_world = frame.camera.camera_to_world
        values = [*to_world[:3, 3], *Rotation.from_matrix(to_world[:3, :3]).as_quat()]
        lines.append(f"{index / 60}, {index:06d}, " + ", ".join(map(repr, map(float, values))))
        depth, confidence = depth_and_confidence(frame)
        save_millimetres(depth, folder / f"depth/{index:06d}.png")
        save(confidence, folder / f"confidence/{index:06d}.png")
    (folder / "odometry.csv").write_text("\n".join(lines) + "\n")
    rows = arkit_intrinsics(frames[0])
    (folder / "camera_matrix.csv").write_text("\n".join(", ".join(map(repr, map(float, row))) for row in rows))


def write_lossless_video(path: Path, images: list[np.ndarray]) -> None:
    """Unlike `write_video`: H.264 leaves little of images as small as those of tests."""
    height, width = images[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), 60, (width, height))
    for image in images:
        writer.write(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    writer.release()


def with_quarter_turn(mp4: bytes, height: int) -> bytes:
    """A video whose track matrix states a clockwise rotation, as phones write it (ISO 14496-12, 8.3.2)."""
    start = mp4.index(b"tkhd") + 4 + 40
    matrix = struct.pack(">9i", 0, 1 << 16, 0, -1 << 16, 0, 0, height << 16, 0, 1 << 30)
    return mp4[:start] + matrix + mp4[start + len(matrix) :]


def write_record3d(capture: Capture, folder: Path, **metadata: Any) -> None:
    """Given fields replace those of the metadata."""
    frames = in_order(capture)
    camera = frames[0].camera
    poses = []
    for index, frame in enumerate(frames):
        to_world = frame.camera.camera_to_world
        poses.append([*Rotation.from_matrix(to_world[:3, :3] * TO_ARKIT).as_quat(), *to_world[:3, 3]])
        save(frame.image, folder / f"rgbd/{index}.jpg", quality=95, subsampling=0)
        if frame.depth is not None:
            depth, confidence = depth_and_confidence(frame)
            (folder / f"rgbd/{index}.depth").write_bytes(lzfse.compress(depth.astype("<f4").tobytes()))
            (folder / f"rgbd/{index}.conf").write_bytes(lzfse.compress(confidence.tobytes()))
    document = {
        "w": camera.width,
        "h": camera.height,
        "dw": camera.width // 2,
        "dh": camera.height // 2,
        "fps": 60,
        "K": camera.intrinsic_matrix.T.ravel().tolist(),
        "poses": [list(map(float, pose)) for pose in poses],
        "initPose": [0, 0, 0, 1, 0, 0, 0],
        **metadata,
    }
    (folder / "metadata").write_text(json.dumps(document))


def zip_folder(folder: Path, archive: Path) -> Path:
    """The archive of a folder's content, stored without compression as Record3D does it."""
    with zipfile.ZipFile(archive, "w") as file:
        for path in sorted(folder.rglob("*")):
            file.write(path, path.relative_to(folder).as_posix())
    return archive


def write_polycam(capture: Capture, folder: Path, kind: str = "corrected_") -> None:
    """`kind` is "corrected_" or ""."""
    for index, frame in enumerate(in_order(capture)):
        camera, timestamp = frame.camera, 1_000_000 + 40_000 * index
        rows = camera.camera_to_world[:3] * np.array([*TO_ARKIT, 1.0])
        fields = {f"t_{row}{column}": rows[row, column] for row in range(3) for column in range(4)}
        fields |= {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
        save(frame.image, folder / f"keyframes/{kind}images/{timestamp}.jpg", quality=95, subsampling=0)
        path = folder / f"keyframes/{kind}cameras/{timestamp}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({**fields, "blur_score": 100.0, "timestamp": timestamp}))
        depth, confidence = depth_and_confidence(frame)
        save_millimetres(depth, folder / f"keyframes/depth/{timestamp}.png")
        spread = np.array([0, 127, 255], np.uint8)[confidence]
        save(spread, folder / f"keyframes/confidence/{timestamp}.png")


def write_nerfcapture(capture: Capture, folder: Path, depth_range: float | None = None) -> None:
    """As the app writes it offline, with useless depth; or as instant-ngp's script does with depth up to a range."""
    entries = []
    for index, frame in enumerate(in_order(capture)):
        camera = frame.camera
        # The app writes ARKit's principal point unchanged.
        cx, cy = (camera.cx, camera.cy) if depth_range else arkit_intrinsics(frame)[:2, 2].tolist()
        entry: dict[str, Any] = {
            "file_path": f"images/{index}",
            "transform_matrix": (camera.camera_to_world * np.array([*TO_ARKIT, 1.0])).tolist(),
            "timestamp": index / 60,
            "depth_path": f"images/{index}.depth.png",
            **{"fl_x": camera.fx, "fl_y": camera.fy, "cx": cx, "cy": cy},
            **{"w": camera.width, "h": camera.height},
        }
        save(frame.image, folder / f"images/{index}.png")
        depth_path = folder / entry["depth_path"]
        if depth_range is None:
            save(np.zeros((*frame.image.shape[:2], 4), np.uint8), depth_path)
        else:
            assert frame.depth is not None
            save((np.minimum(frame.depth, depth_range) * 65535 / depth_range).astype(np.uint16), depth_path)
        entries.append(entry)
    scale = {"depth_integer_scale": 1.0} if depth_range is None else {"integer_depth_scale": depth_range / 65535}
    shared = {"fl_x": 1.0, "fl_y": 1.0, "cx": 320, "cy": 240, "w": 0, "h": 0}
    (folder / "transforms.json").write_text(json.dumps({**shared, **scale, "frames": entries}))


def write_scanner_app(capture: Capture, folder: Path) -> None:
    """A photograph for every third pose, as the app has it; the poses between are its neighbour's."""
    folder.mkdir(parents=True)
    frames = in_order(capture)
    for number in range(3 * len(frames)):
        frame, name = frames[number // 3], f"{number:05d}"
        matrix, camera = arkit_intrinsics(frame), frame.camera
        projection = np.zeros((4, 4))
        projection[0, [0, 2]] = 2 * camera.fx / camera.width, 1 - 2 * camera.cx / camera.width
        projection[1, [1, 2]] = 2 * camera.fy / camera.height, 2 * camera.cy / camera.height - 1
        pose = camera.camera_to_world * np.array([*TO_ARKIT, 1.0])
        fields = {"cameraPoseARFrame": pose, "intrinsics": matrix, "projectionMatrix": projection}
        document = {"frame_index": number, **{name: value.ravel().tolist() for name, value in fields.items()}}
        (folder / f"frame_{name}.json").write_text(json.dumps(document))
        depth, confidence = depth_and_confidence(frame)
        save_millimetres(depth, folder / f"depth_{name}.png")
        save(confidence, folder / f"conf_{name}.png")
        if number % 3 == 0:
            save(frame.image, folder / f"frame_{name}.jpg", quality=95, subsampling=0)


WRITERS: dict[str, Callable[[Capture, Path], None]] = {
    "stray-scanner": write_stray_scanner,
    "record3d": write_record3d,
    "3d-scanner-app": write_scanner_app,
    "polycam": write_polycam,
    "nerfstudio": write_nerfcapture,
}
"""By the name of the format that each is read as."""


def edit_json(path: Path, **replaced: object) -> None:
    """Replace fields of a JSON object in a file."""
    path.write_text(json.dumps({**json.loads(path.read_text()), **replaced}))


def frames_of(path: Path) -> list[Frame]:
    """All frames of a capture, by name."""
    frames = open_capture(path, hold_out=0).frames
    return sorted(frames, key=lambda frame: frame.name)


def assert_same_views(found: list[Frame], expected: list[Frame], border: int = 0) -> None:
    """The cameras agree to 1e-5, the images but for compression; `border` pixels have been cut off at each side."""
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        camera = other.camera
        camera = camera.cropped(border, border, camera.width - 2 * border, camera.height - 2 * border)
        np.testing.assert_allclose(one.camera.world_to_camera, camera.world_to_camera, atol=1e-5)
        np.testing.assert_allclose(one.camera.intrinsic_matrix, camera.intrinsic_matrix, rtol=1e-5)
        image = other.image[border : border + camera.height, border : border + camera.width]
        assert one.image.shape == image.shape
        assert psnr(one.image / np.float32(255), image / np.float32(255)) > 30
