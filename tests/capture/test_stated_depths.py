"""Masks and depth maps that transforms JSON files state."""

from __future__ import annotations

import numpy as np
from PIL import Image

from pocketgs.capture import open_capture


def test_masks_and_depths(ring, write_transforms):
    frames = ring.transforms()["frames"]
    folder = write_transforms()
    mask = np.zeros((12, 16), dtype=np.uint8)
    mask[:, 8:] = 255
    Image.fromarray(mask).save(folder / "mask.png")
    depth = np.full((6, 8), 1500, dtype=np.uint16)
    depth[0] = 0
    Image.fromarray(depth).save(folder / "depth.png")
    np.save(folder / "depth.npy", np.full((12, 16), 2.0, dtype=np.float32))
    frames[0].update(mask_path="mask.png", depth_file_path="depth.png")
    frames[1].update(depth_file_path="depth.npy", depth_unit_scale_factor=1.0)
    write_transforms(frames=frames)
    first, second = sorted(open_capture(folder).frames, key=lambda frame: frame.name)[:2]
    np.testing.assert_array_equal(first.mask, mask > 0)
    np.testing.assert_allclose(first.depth[2:], 1.5)
    np.testing.assert_array_equal(first.depth[:2], 0)
    np.testing.assert_array_equal(second.depth, 2.0)


def test_absent_depth_maps_are_left_out(ring, write_transforms):
    frames = ring.transforms()["frames"]
    for frame in frames[2:5]:
        frame["depth_file_path"] = "depth/absent.png"
    capture = open_capture(write_transforms(frames=frames))
    assert [frame.depth for frame in capture.frames] == [None] * 10
    (warning,) = capture.warnings
    assert warning.endswith("json: 3 of its depth maps have no file where it states, the first depth/absent.png")


def test_absent_masks_are_left_out(ring, write_transforms):
    frames = ring.transforms()["frames"]
    for frame in frames[2:5]:
        frame["mask_path"] = "masks/absent.png"
    capture = open_capture(write_transforms(frames=frames))
    assert [frame.mask for frame in capture.frames] == [None] * 10
    (warning,) = capture.warnings
    assert warning.endswith("transforms.json: 3 of its masks have no file where it states, the first masks/absent.png")


def test_depth_of_another_shape_is_left_out(ring, write_transforms):
    frames, folder = ring.transforms()["frames"], write_transforms()
    for index, shape in ((0, (6, 8)), (1, (8, 6)), (2, (16, 12))):
        np.save(folder / f"{index}.npy", np.full(shape, 2.0, np.float32))
        frames[index]["depth_file_path"] = f"{index}.npy"
    capture = open_capture(write_transforms(frames=frames))
    assert [frame.name for frame in capture.frames if frame.depth is not None] == ["images/view_00.png"]
    (warning,) = capture.warnings
    assert warning.startswith(
        "the depth maps of 2 frames have not the shape of their photographs, the first of images/"
    )


def test_pictures_of_depth_are_left_out(ring, write_transforms):
    """Depth in colours says nothing; floating-point numbers have the stated unit, as in .npy files."""
    frames, folder = ring.transforms()["frames"], write_transforms()
    pictures = {
        0: np.zeros((12, 16, 3), np.uint8),
        1: np.full((12, 16), 2.0, np.float32),
        2: np.zeros((9, 4), np.uint8),
    }
    for index, picture in pictures.items():
        Image.fromarray(picture).save(folder / f"{index}.tif")
        frames[index].update(depth_file_path=f"{index}.tif", depth_unit_scale_factor=0.5)
    capture = open_capture(write_transforms(frames=frames), hold_out=0)
    assert [frame.depth is None for frame in capture.train] == [True, False, *[True] * 8]
    np.testing.assert_array_equal(capture.train[1].depth, 1.0)
    unreadable, misshapen = capture.warnings
    assert "depth maps of 1 frames cannot be used, the first of images/view_00.png: they are left out (" in unreadable
    assert "0.tif: cannot be decoded (mode RGB is not" in unreadable
    assert misshapen.startswith("the depth maps of 1 frames have not the shape")
