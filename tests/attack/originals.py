"""A sound example of everything that readers read, small enough to be read thousands of times."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image
from plyfile import PlyData, PlyElement
from scipy.spatial.transform import Rotation

from capture import phone_layouts
from pocketgs.capture import Capture
from pocketgs.capture.colmap_export import export_capture
from pocketgs.capture.synthetic import true_capture
from pocketgs.results.cameras_file import write_cameras
from pocketgs.scene.formats import spz, write_scene
from pocketgs.scene.gaussians import Gaussians
from pocketgs.sort_free.file import write_sort_free
from pocketgs.sort_free.scene import sort_free

TO_OPENGL = np.array([1.0, -1.0, -1.0, 1.0])


def small_capture() -> Capture:
    """Five views of the demo's room."""
    return true_capture(width=48, height=36, frames=5, points=60)


def write_captures(capture: Capture, folder: Path) -> dict[str, Path]:
    """Captures that `open_capture` opens, by the name of their layout."""
    writers: dict[str, Callable[[Capture, Path], None]] = {
        "nerfstudio": write_nerfstudio,
        "blender": write_blender,
        "llff": write_llff,
        "colmap text": lambda capture, path: export_capture(path, capture),
        "colmap binary": write_colmap_binary,
        "polycam": phone_layouts.write_polycam,
        "record3d": phone_layouts.write_record3d,
        "stray scanner": phone_layouts.write_stray_scanner,
        "nerfcapture": phone_layouts.write_nerfcapture,
    }
    found = {name: folder / name for name in writers}
    for name, write in writers.items():
        write(capture, found[name])
    (folder / "archive").mkdir()
    found["archive"] = phone_layouts.zip_folder(found["record3d"], folder / "archive" / "recording.r3d")
    return found


def write_scenes(folder: Path) -> dict[str, Path]:
    """Files that `load_any` reads, by a name; each in a folder of its own."""
    rng = np.random.default_rng(0)
    scene = Gaussians(*(rng.normal(size=(300, *shape)) for shape in ((3,), (3,), (4,), (), (4, 3))))
    found = {}
    for name in (
        "scene.ply",
        "scene.compressed.ply",
        "scene.spz",
        "scene.splat",
        "scene.glb",
        "scene.pgs",
        "scene.sog",
    ):
        (folder / name).mkdir(parents=True)
        found[name] = folder / name / name
        write_scene(found[name], scene)
    for name in ("free.ply", "free.pgs"):
        (folder / name).mkdir()
        found[name] = folder / name / name
        write_sort_free(found[name], sort_free(scene, "lc", 1.0))
    (folder / "old").mkdir()
    found["old.spz"] = folder / "old" / "old.spz"
    spz.write_gaussians(found["old.spz"], scene, version=3)
    (folder / "text").mkdir()
    found["scene.gltf"] = folder / "text" / "scene.gltf"
    _unpack_glb(found["scene.glb"], found["scene.gltf"])
    (folder / "ascii").mkdir()
    found["ascii.ply"] = folder / "ascii" / "ascii.ply"
    data = PlyData.read(str(found["scene.ply"]))
    PlyData([PlyElement.describe(data["vertex"].data[:20], "vertex")], text=True).write(str(found["ascii.ply"]))
    return found


def write_result(capture: Capture, folder: Path, scene: Path) -> Path:
    """Files of a result folder that `view` and others read."""
    folder.mkdir(parents=True)
    shutil.copy(scene, folder / "scene.ply")
    write_cameras(folder / "cameras.json", capture.frames, refined=True)
    images = [{"name": frame.name, "psnr": 30.0} for frame in capture.held_out]
    record = {"psnr": 30.0, "images": images, "capture": {"background": [0.0, 0.5, 1.0], "name": "room"}}
    (folder / "run.json").write_text(json.dumps(record))
    (folder / "held_out").mkdir()
    Image.fromarray(capture.train[0].image).save(folder / "held_out" / "0.png")
    return folder


def write_nerfstudio(capture: Capture, folder: Path) -> None:
    """A transforms.json with a lens, masks, depth, a cloud and a split."""
    assert capture.points is not None
    frames = []
    for number, frame in enumerate(sorted(capture.frames, key=lambda frame: frame.name)):
        phone_layouts.save(frame.image, folder / f"images/{number}.png")
        phone_layouts.save(np.full(frame.image.shape[:2], 255, np.uint8), folder / f"masks/{number}.png")
        assert frame.depth is not None
        phone_layouts.save_millimetres(frame.depth, folder / f"depth/{number}.png")
        files = {"file_path": f"images/{number}.png", "mask_path": f"masks/{number}.png"}
        pose = (frame.camera.camera_to_world * TO_OPENGL).tolist()
        frames.append({**files, "depth_file_path": f"depth/{number}.png", "transform_matrix": pose})
    camera = capture.train[0].camera
    names = [frame["file_path"] for frame in frames]
    document = {
        **{"camera_model": "OPENCV", "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy},
        **{"w": camera.width, "h": camera.height, "k1": 0.01, "k2": 0.001, "p1": 0.0, "p2": 0.0},
        **{"ply_file_path": "cloud.ply", "train_filenames": names[1:], "test_filenames": names[:1], "frames": frames},
    }
    (folder / "transforms.json").write_text(json.dumps(document))
    vertices = np.array([tuple(position) for position in capture.points.positions], [(axis, "f4") for axis in "xyz"])
    PlyData([PlyElement.describe(vertices, "vertex")]).write(str(folder / "cloud.ply"))


def write_blender(capture: Capture, folder: Path) -> None:
    """Pictures with alpha in two splits."""
    frames = sorted(capture.frames, key=lambda frame: frame.name)
    for split, chosen in (("train", frames[1:]), ("test", frames[:1])):
        listed = []
        for number, frame in enumerate(chosen):
            alpha = np.full((*frame.image.shape[:2], 1), 200, np.uint8)
            phone_layouts.save(np.concatenate([frame.image, alpha], axis=2), folder / f"{split}/{number}.png")
            pose = (frame.camera.camera_to_world * TO_OPENGL).tolist()
            listed.append({"file_path": f"./{split}/{number}", "transform_matrix": pose})
        angle = 2 * np.arctan(frames[0].camera.width / 2 / frames[0].camera.fx)
        (folder / f"transforms_{split}.json").write_text(json.dumps({"camera_angle_x": angle, "frames": listed}))


def write_llff(capture: Capture, folder: Path) -> None:
    """Poses and images, as LLFF has them."""
    export_capture(folder, capture)
    shutil.rmtree(folder / "sparse")
    rows = []
    for frame in sorted(capture.frames, key=lambda frame: frame.name):
        right, down, forward, centre = frame.camera.camera_to_world[:3].T
        size = [frame.camera.height, frame.camera.width, frame.camera.fx]
        rows.append([*np.stack([down, right, -forward, centre, size], axis=1).ravel(), 1.0, 2.0])
    np.save(folder / "poses_bounds.npy", np.array(rows))


def write_colmap_binary(capture: Capture, folder: Path) -> None:
    """COLMAP's model with one camera that has a lens."""
    assert capture.points is not None
    frames = sorted(capture.frames, key=lambda frame: frame.name)
    camera = frames[0].camera
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    lens = [camera.fx, camera.fy, camera.cx, camera.cy, 0.01, 0.0, 0.0, 0.0]
    stated = struct.pack("<QiiQQ8d", 1, 1, 4, camera.width, camera.height, *lens)
    (model / "cameras.bin").write_bytes(stated)
    images = [struct.pack("<Q", len(frames))]
    for number, frame in enumerate(frames):
        phone_layouts.save(frame.image, folder / f"images/{number}.png")
        x, y, z, w = Rotation.from_matrix(frame.camera.world_to_camera[:3, :3]).as_quat()
        pose = (w, x, y, z, *frame.camera.world_to_camera[:3, 3])
        images.append(struct.pack("<I7dI", number, *pose, 1) + f"{number}.png\0".encode())
        images.append(struct.pack("<Q", 2) + struct.pack("<ddq", 1.0, 2.0, -1) * 2)
    (model / "images.bin").write_bytes(b"".join(images))
    points = [struct.pack("<Q", len(capture.points))]
    for number, position in enumerate(capture.points.positions):
        points.append(
            struct.pack("<Q3d3BdQ", number, *map(float, position), 1, 2, 3, 0.5, 1) + struct.pack("<II", 0, 1)
        )
    (model / "points3D.bin").write_bytes(b"".join(points))


def _unpack_glb(glb: Path, gltf: Path) -> None:
    """The same scene as JSON with a file beside it."""
    content = glb.read_bytes()
    size = struct.unpack_from("<I", content, 12)[0]
    document = json.loads(content[20 : 20 + size])
    document["buffers"][0]["uri"] = "scene.bin"
    gltf.write_text(json.dumps(document))
    gltf.with_name("scene.bin").write_bytes(content[28 + size :])
