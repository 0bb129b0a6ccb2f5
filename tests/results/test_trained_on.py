"""What a run was trained on: by name where that is known, by pose otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pocketgs import Capture
from pocketgs.results.cameras_file import SavedCameras
from pocketgs.results.trained_on import TrainedOn
from pocketgs.scene.background import BLACK


def of_run(capture: Capture) -> TrainedOn:
    cameras = SavedCameras({frame.name: frame.camera for frame in capture.frames}, refined=False)
    views = frozenset(frame.name for frame in capture.train)
    return TrainedOn(BLACK, views, cameras, held_out=True, protocol=capture.protocol, shrink=1)


def test_the_runs_own_capture(small_capture: Capture) -> None:
    known = of_run(small_capture)
    assert known.overlap(small_capture) is None
    assert known.difference(small_capture) is None


def test_photographs_from_a_tripod_are_known_by_name(small_capture: Capture) -> None:
    """Held-out ones have the pose of training views, and are none."""
    camera = small_capture.train[0].camera
    held_out = [replace(frame, camera=camera) for frame in small_capture.held_out]
    capture = replace(small_capture, held_out=held_out)
    known = of_run(capture)
    assert known.cameras.at_pose_of(held_out[0]) == [small_capture.train[0].name, held_out[0].name]
    assert known.overlap(capture) is None
    renamed = replace(capture, held_out=[replace(frame, name=f"copy/{frame.name}") for frame in held_out])
    assert "was trained on 1 of the 1 view that is held out" in (known.overlap(renamed) or "")


def test_copies_have_other_names_and_rounded_poses(small_capture: Capture) -> None:
    known, first = of_run(small_capture), small_capture.train[0]
    pose = np.float32(first.camera.world_to_camera).astype(np.float64)
    copy = replace(first, name="copy.png", camera=replace(first.camera, world_to_camera=pose))
    assert known.overlap(replace(small_capture, held_out=[copy])) is not None
    pose[:3, 3] += 0.01 * np.ptp([frame.camera.centre for frame in small_capture.frames])
    moved = replace(copy, camera=replace(first.camera, world_to_camera=pose))
    assert known.overlap(replace(small_capture, held_out=[moved])) is None


def test_other_poses_of_the_same_names_are_another_capture_or_another_world(small_capture: Capture) -> None:
    known, frames = of_run(small_capture), []
    for frame in small_capture.frames:
        pose = frame.camera.world_to_camera.copy()
        pose[:3, 3] += 0.5
        frames.append(replace(frame, camera=replace(frame.camera, world_to_camera=pose)))
    first, *others = frames
    capture = replace(small_capture, train=others, held_out=[first])
    assert known.cameras.at_pose_of(first) == []
    assert known.overlap(capture) is None
    assert "8 views have other poses than in its run, the first 0002.png" in (known.difference(capture) or "")
    other_sizes = replace(capture, protocol="other sizes")
    assert "8 views have other poses" in (known.difference(other_sizes) or "")
    assert "here it is 'other sizes'" in (known.difference(other_sizes) or "")


def test_no_cameras_are_known(small_capture: Capture) -> None:
    known = replace(of_run(small_capture), cameras=SavedCameras({}, refined=False), views=frozenset())
    assert known.overlap(small_capture) is None
    assert known.difference(small_capture) is None
