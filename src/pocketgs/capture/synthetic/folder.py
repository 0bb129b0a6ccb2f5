"""The demo capture on disk, in nerfstudio's layout, with its ground truth."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pocketgs.capture.capture import Frame
from pocketgs.capture.frame_parts import reliable_depth
from pocketgs.capture.open import read_listing
from pocketgs.capture.synthetic.phone import Shot
from pocketgs.capture.synthetic.recording import GroundTruth, check_sizes, frame_name, record
from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_folder import replacing_folder
from pocketgs.files.manifest import files_below
from pocketgs.files.written_files import WRITTEN, check_only_written, without_browser_files
from pocketgs.geometry.camera import Camera

GENERATED, MADE_BY = "generated.json", "pocketgs demo"
"""File that marks a folder as a demo, and states the version that made it."""

GROUND_TRUTH = "ground_truth"
DEPTH_UNIT = 0.0002  # metres per unit: 16 bits reach 13 m

OPENGL_AXES = np.array([1.0, -1.0, -1.0, 1.0])


def write_demo(folder: Path, width: int = 480, height: int = 360, frames: int = 120) -> None:
    """Write `demo_capture` for `open_capture`, and `demo_ground_truth` for `read_ground_truth`.

    A folder that already holds this demo is kept; an older demo is replaced. The folder is written atomically: an
    interruption leaves the earlier content.

    Args:
        folder: target; parents are created.
        width: as in `demo_capture`.
        height: as in `demo_capture`.
        frames: as in `demo_capture`.

    Raises:
        PocketGSError: the folder holds anything but a demo, or an older demo and other files, or cannot be written, or
            as `demo_capture`.
    """
    check_sizes(width, height, frames)
    stamp = {"made_by": MADE_BY, "generator": _digest(), "width": width, "height": height, "frames": frames}
    try:
        before = _read_stamp(folder) or {}
        if stamp.items() <= before.items() and _is_whole(folder, frames):
            return
        check_only_written(folder, before.get(WRITTEN))
        with replacing_folder(folder) as (staging, _):
            _write(staging, width, height, frames)
            _write_json(staging / GENERATED, {**stamp, WRITTEN: [*files_below(staging), GENERATED]})
    except OSError as error:
        raise PocketGSError(f"{folder}: the demo cannot be written ({error.strerror or error})") from error


def read_ground_truth(folder: Path) -> GroundTruth:
    """Read the ground truth that `write_demo` wrote, depths rounded to 0.2 mm.

    Raises:
        PocketGSError: it is missing or damaged.
    """
    sources = {f"images/{Path(source.name).name}": source for source in read_listing(folder / GROUND_TRUTH).frames}
    return GroundTruth(
        cameras={name: source.camera for name, source in sources.items()},
        depths={name: reliable_depth(source) for name, source in sources.items()},
    )


def write_frames(folder: Path, frames: Sequence[Frame], held_out: Collection[int] = ()) -> None:
    """Write posed photographs, in metres, in nerfstudio's format; the folder must not exist yet.

    Args:
        folder: target.
        frames: to write.
        held_out: indices of the frames to hold out; if empty, the file states no split.
    """
    (folder / "images").mkdir(parents=True)
    for frame in frames:
        _write_png(folder / frame.name, frame.image)
    names = [frame.name for frame in frames]
    document = _transforms([frame.camera for frame in frames], names)
    if held_out:
        document["test_filenames"] = [names[number] for number in held_out]
        document["train_filenames"] = [name for name in names if name not in document["test_filenames"]]
    _write_json(folder / "transforms.json", document)


def _write(folder: Path, width: int, height: int, frames: int) -> None:
    (folder / "images").mkdir()
    (folder / GROUND_TRUTH / "depth").mkdir(parents=True)
    shots = []
    for shot, image, depth in record(width, height, frames):
        _write_png(folder / frame_name(shot), image)
        _write_png(folder / GROUND_TRUTH / _depth_name(shot), np.round(depth / DEPTH_UNIT).astype(np.uint16))
        shots.append(shot)
    split = {
        "train_filenames": [frame_name(shot) for shot in shots if not shot.held_out],
        "test_filenames": [frame_name(shot) for shot in shots if shot.held_out],
    }
    sensed = _transforms([shot.sensed for shot in shots], [frame_name(shot) for shot in shots])
    # The depth maps are its images: paths in a capture may not leave its folder.
    true = _transforms([shot.camera for shot in shots], [_depth_name(shot) for shot in shots])
    for fields in true["frames"]:
        fields["depth_file_path"] = fields["file_path"]
    _write_json(folder / "transforms.json", {**sensed, **split})
    _write_json(folder / GROUND_TRUTH / "transforms.json", {**true, "depth_unit_scale_factor": DEPTH_UNIT})


def _depth_name(shot: Shot) -> str:
    return f"depth/{Path(frame_name(shot)).name}"


def _transforms(cameras: Sequence[Camera], names: Sequence[str]) -> dict[str, Any]:
    """Content of nerfstudio's transforms.json: poses are camera to world, in OpenGL axes."""
    first = cameras[0]
    return {
        "camera_model": "PINHOLE",
        "metric": True,
        "w": first.width,
        "h": first.height,
        "fl_x": first.fx,
        "fl_y": first.fy,
        "cx": first.cx,
        "cy": first.cy,
        "frames": [
            {"file_path": name, "transform_matrix": (camera.camera_to_world * OPENGL_AXES).tolist()}
            for camera, name in zip(cameras, names, strict=True)
        ],
    }


def _write_png(path: Path, pixels: np.ndarray) -> None:
    # Noise hardly compresses at any level.
    Image.fromarray(pixels).save(path, compress_level=1)


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _read_stamp(folder: Path) -> dict[str, Any] | None:
    """The stamp of the demo in a folder; None if the folder is empty or missing.

    Raises:
        PocketGSError: the folder is a file, or was not made by `write_demo`.
    """
    if not folder.exists() or (folder.is_dir() and not without_browser_files(path.name for path in folder.iterdir())):
        return None
    try:
        stamp = json.loads((folder / GENERATED).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        stamp = None
    if not isinstance(stamp, dict) or stamp.get("made_by") != MADE_BY:
        raise PocketGSError(f"{folder}: holds no {GENERATED} of a demo, expected a demo's folder or an empty one")
    return stamp


def _is_whole(folder: Path, frames: int) -> bool:
    """Whether all files of a demo are still there."""
    parts = (folder / "images", folder / GROUND_TRUTH / "depth")
    pictures = all(len(list(part.glob("*.png"))) == frames for part in parts)
    return pictures and all((part / "transforms.json").is_file() for part in (folder, folder / GROUND_TRUTH))


def _digest() -> str:
    """Digest of the sources that determine the demo's images."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
