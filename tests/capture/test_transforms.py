"""The readers of transforms JSON files: nerfstudio and Blender."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from plyfile import PlyData, PlyElement

from pocketgs.capture import open_capture
from pocketgs.capture.open import read_listing
from pocketgs.errors import PocketGSError
from pocketgs.geometry.lens import PINHOLE


def test_reads_poses_and_intrinsics(ring, write_transforms, assert_same_cameras):
    capture = open_capture(write_transforms())
    assert capture.format == "nerfstudio"
    assert [frame.name for frame in capture.held_out] == ["images/view_00.png", "images/view_08.png"]
    frames = sorted(capture.frames, key=lambda frame: frame.name)
    assert_same_cameras([frame.camera for frame in frames], ring.cameras)
    for frame, image in zip(frames, ring.images, strict=True):
        np.testing.assert_array_equal(frame.image, image)


def test_the_file_itself_may_be_given(write_transforms):
    folder = write_transforms()
    assert len(open_capture(folder / "transforms.json").frames) == 10


def test_a_frame_overrides_the_file(ring, write_transforms):
    frames = ring.transforms()["frames"]
    frames[3].update(fl_x=25.0, cx=7.0, camera_model="OPENCV_FISHEYE", k1=0.1)
    listing = read_listing(write_transforms(frames=frames))
    assert listing.frames[2].lens == PINHOLE
    assert (listing.frames[3].camera.fx, listing.frames[3].camera.cx) == (25.0, 7.0)
    assert listing.frames[3].lens.model == "fisheye"
    assert listing.frames[3].lens.coefficients == (0.1, 0, 0, 0)


def test_field_of_view_and_image_size_stand_in_for_intrinsics(ring, write_transforms):
    angle = 2 * math.atan(8 / FOCAL_FROM_ANGLE)
    nothing = dict.fromkeys(("fl_x", "fl_y", "cx", "cy", "w", "h"))
    camera = read_listing(write_transforms(**nothing, camera_angle_x=angle)).frames[0].camera
    assert (camera.width, camera.height, camera.cx, camera.cy) == (16, 12, 8, 6)
    assert camera.fx == pytest.approx(FOCAL_FROM_ANGLE)
    assert camera.fy == camera.fx


FOCAL_FROM_ANGLE = 17.0


def test_coefficients_are_put_in_opencv_order(write_transforms):
    given_ones = {name: number for number, name in enumerate(("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"), 1)}
    lens = read_listing(write_transforms(**given_ones)).frames[0].lens
    assert lens.coefficients == (1, 2, 7, 8, 3, 4, 5, 6)


@pytest.mark.parametrize("at", ["file", "frames"])
def test_nerfstudios_list_of_coefficients(ring, write_transforms, at):
    """It goes before a field each; a frame's own fields go before the file's list."""
    stated = {"distortion_params": [1, 2, 3, 0, 5, 6], "k1": 9}
    frames = ring.transforms()["frames"]
    frames[1] |= {"camera_model": "OPENCV_FISHEYE", "distortion_params": [0.1, 0.2, 0.3, 0.4, 0, 0]}
    frames[2] |= {"k1": 0.7}
    if at == "frames":
        frames[0] |= stated
    listing = read_listing(write_transforms(frames=frames, **(stated if at == "file" else {})))
    assert listing.frames[0].lens.coefficients == (1, 2, 5, 6, 3, 0, 0, 0)
    assert listing.frames[1].lens.coefficients == (0.1, 0.2, 0.3, 0.4)
    assert listing.frames[2].lens.coefficients[:2] == (0.7, 0)


def test_numbers_as_text(write_transforms):
    """As nerfstudio writes the lenses of RealityCapture."""
    lens = read_listing(write_transforms(k1="-0.0512", k2=" 3e-2", p1="0.0", k4="0.0")).frames[0].lens
    assert lens.coefficients[:2] == (-0.0512, 0.03)


@pytest.mark.parametrize("stated", [{"k4": 0.02}, {"k4": "0.02"}, {"distortion_params": [0, 0, 0, 0.02, 0, 0]}])
def test_a_fourth_radial_term_is_refused(write_transforms, stated):
    with pytest.raises(PocketGSError, match=r"coefficient k4 is 0\.02, a fourth radial term, .* calibrate without it"):
        read_listing(write_transforms(**stated))
    if "k4" in stated:
        lens = read_listing(write_transforms(**stated, camera_model="FULL_OPENCV")).frames[0].lens
        assert lens.coefficients == (0, 0, 0, 0, 0, 0.02, 0, 0)


MATRIX = [[30.0, 0, 7], [0, 31, 5], [0, 0, 1]]
RIGHT_ANGLE = {"camera_angle_x": math.pi / 2}


@pytest.mark.parametrize(
    ("shared", "own", "expected"),
    [
        ({"fl_x": 20, "fl_y": 20, "cx": 8, "cy": 6}, {"K": MATRIX}, (30, 31, 7, 5)),
        ({"fl_x": 20, "fl_y": 20, "cx": 7}, RIGHT_ANGLE, (8, 8, 7, 6)),
        ({"camera_angle_x": 0.7, "camera_angle_y": 0.6}, {"K": MATRIX}, (30, 31, 7, 5)),
        ({"K": (2 * np.array(MATRIX)).tolist()}, {"intrinsics": MATRIX}, (30, 31, 7, 5)),
        ({"K": MATRIX}, RIGHT_ANGLE, (8, 8, 8, 6)),
        ({"w": 16, "h": 12, "fl_x": 20}, {"width": 32, "height": 24}, (20, 20, 16, 12)),
        ({"camera_angle_x": 0.7, "fl_y": 21, "cx": 7}, {"fl_x": 25, "K": MATRIX}, (25, 21, 7, 6)),
    ],
)
def test_what_a_frame_states_otherwise_goes_before_the_files(ring, write_transforms, shared, own, expected):
    nothing = dict.fromkeys(("fl_x", "fl_y", "cx", "cy", "w", "h"))
    frames = [frame | own for frame in ring.transforms()["frames"]]
    camera = read_listing(write_transforms(**nothing | shared, frames=frames)).frames[0].camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx(expected)


def test_absent_images_are_counted_in_one_warning(write_transforms):
    folder = write_transforms()
    for name in ("view_02.png", "view_05.png"):
        (folder / "images" / name).unlink()
    capture = open_capture(folder)
    assert len(capture.frames) == 8
    (warning,) = capture.warnings
    assert "2 of 10" in warning
    assert "images/view_02.png" in warning


def test_other_image_folder(ring, write_transforms):
    folder = write_transforms()
    (folder / "images_2").mkdir()
    for name, image in zip(ring.names, ring.images, strict=True):
        Image.fromarray(image[::2, ::2]).save(folder / "images_2" / name)
    camera = open_capture(folder, images="images_2").train[0].camera
    assert (camera.width, camera.height, camera.fx, camera.cx) == (8, 6, 10.0, 4.25)


def test_own_split(ring, write_transforms):
    paths = [frame["file_path"] for frame in ring.transforms()["frames"]]
    folder = write_transforms(train_filenames=paths[:6], val_filenames=paths[6:8], test_filenames=paths[8:])
    capture = open_capture(folder)
    assert [frame.name for frame in capture.held_out] == paths[8:]
    assert [frame.name for frame in capture.train] == paths[:6]
    assert capture.protocol.endswith("data set's own split")
    write_transforms(train_filenames=paths[:6], val_filenames=paths[6:8])
    assert [frame.name for frame in open_capture(folder).held_out] == paths[6:8]
    assert len(open_capture(folder, hold_out=0).train) == 8
    write_transforms(train_filenames=paths[:6])
    alone = open_capture(folder)
    assert (len(alone.train), len(alone.held_out), alone.warnings) == (5, 1, ())
    assert alone.protocol.endswith("every 8th by name")


@pytest.mark.parametrize("part", ["val_filenames", "test_filenames"])
def test_frames_both_for_training_and_held_out(ring, write_transforms, part):
    paths = [frame["file_path"] for frame in ring.transforms()["frames"]]
    folder = write_transforms(train_filenames=paths, **{part: paths[8:]})
    capture = open_capture(folder)
    assert ([frame.name for frame in capture.held_out], len(capture.train)) == (paths[8:], 8)
    said = "2 of 10 images for training are held out too, the first images/view_08.png: they are not trained on; --"
    assert said in capture.warnings[0]
    assert len(open_capture(folder, hold_out=0).train) == 10


def write_cloud(ring, path: Path) -> None:
    rows = [(*p, *c) for p, c in zip(ring.positions, ring.colours, strict=True)]
    names = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
    PlyData([PlyElement.describe(np.array(rows, dtype=names), "vertex")]).write(path)


def test_cloud(ring, write_transforms):
    folder = write_transforms(ply_file_path="cloud.ply")
    assert "cloud.ply is absent" in open_capture(folder).warnings[0]
    write_cloud(ring, folder / "cloud.ply")
    points = open_capture(folder).points
    np.testing.assert_allclose(points.positions, ring.positions, rtol=1e-6)
    np.testing.assert_allclose(points.colours, ring.colours / 255, rtol=1e-6)
    whole = (folder / "cloud.ply").read_bytes()
    for length in range(0, len(whole), 7):
        (folder / "cloud.ply").write_bytes(whole[:length])
        with pytest.raises(PocketGSError, match=r"cloud\.ply"):
            read_listing(folder)


def blender_scene(ring, folder: Path) -> Path:
    """The ring as a NeRF-Synthetic scene: first seven to train, last three to test."""
    document = ring.transforms()
    alpha = np.full((12, 16), 128, dtype=np.uint8)
    for part, chosen in (("train", slice(0, 7)), ("test", slice(7, 10))):
        (folder / part).mkdir()
        frames = document["frames"][chosen]
        for number, (frame, image) in enumerate(zip(frames, ring.images[chosen], strict=True)):
            frame["file_path"] = f"./{part}/r_{number}"
            Image.fromarray(np.dstack([image, alpha])).save(folder / part / f"r_{number}.png")
        content = {"camera_angle_x": 2 * math.atan(8 / 20), "frames": frames}
        (folder / f"transforms_{part}.json").write_text(json.dumps(content))
    return folder


def test_blender_scene(ring, tmp_path):
    capture = open_capture(blender_scene(ring, tmp_path))
    assert capture.format == "blender"
    assert [frame.name for frame in capture.held_out] == ["test/r_0.png", "test/r_1.png", "test/r_2.png"]
    assert len(capture.train) == 7
    assert capture.protocol == "16x12, on white, data set's own split"
    assert capture.train[0].camera.fx == pytest.approx(20)
    expected = 255 + (ring.images[0] - 255.0) * (128 / 255)
    assert np.abs(capture.train[0].image - expected).max() <= 0.5 + 1e-4
    assert np.all(capture.train[0].alpha == 128)
    with pytest.raises(PocketGSError, match="images="):
        open_capture(tmp_path, images="train")


def test_a_blender_scene_whose_test_images_are_trained_on_too(ring, tmp_path):
    blender_scene(ring, tmp_path)
    train, test = (json.loads((tmp_path / f"transforms_{part}.json").read_text()) for part in ("train", "test"))
    test["frames"] += train["frames"][:2]
    (tmp_path / "transforms_test.json").write_text(json.dumps(test))
    capture = open_capture(tmp_path)
    assert (len(capture.train), len(capture.held_out)) == (5, 5)
    assert "2 of 7 images for training are held out too, the first train/r_0.png" in capture.warnings[0]
    assert len(open_capture(tmp_path, hold_out=0).train) == 10


def test_blender_without_test_split(ring, tmp_path):
    blender_scene(ring, tmp_path)
    (tmp_path / "transforms_test.json").unlink()
    assert "every 8th" in open_capture(tmp_path).protocol


def test_blender_without_test_images(ring, tmp_path):
    """People leave the test images out to save space, but keep the file that lists them."""
    blender_scene(ring, tmp_path)
    shutil.rmtree(tmp_path / "test")
    capture = open_capture(tmp_path)
    assert "every 8th" in capture.protocol
    assert (len(capture.train), len(capture.held_out)) == (6, 1)


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("frames", [], "no frame"),
        ("frames", {"0": {}}, "expected a list of objects"),
        ("frames", [1], "expected a list of objects"),
        ("frames", None, "expected a list of objects"),
        ("fl_x", "20 px", "fl_x"),
        ("fl_x", -1.0, "focal lengths"),
        ("fl_x", 10**400, "fl_x"),
        ("w", -16, "image size"),
        ("w", 1e12, "image size"),
        ("cx", float("nan"), "cx"),
        ("cx", 1e300, "principal point"),
        ("camera_model", "EQUIRECTANGULAR", "expected one of PINHOLE"),
        ("ftheta_p0", 0.0, "'ftheta_p0' states another lens, expected a 'camera_model', one of PINHOLE"),
        ("equirectangular", True, "'equirectangular' states another lens"),
        ("latlong", {}, "'latlong' states another lens"),
        ("orthographic", True, "'orthographic' states another lens"),
        ("camera_angle_x", 4.0, "radians"),
        ("ply_file_path", "../cloud.ply", "outside"),
        ("test_filenames", "images/view_00.png", "list of strings"),
        ("k1", [0.1], "k1"),
        ("is_fisheye", "yes", "true or false"),
    ],
)
def test_wrong_fields_are_named(write_transforms, field, value, said):
    nothing = {"fl_x": None} if field == "camera_angle_x" else {}
    with pytest.raises(PocketGSError, match=said) as caught:
        open_capture(write_transforms(**nothing, **{field: value}))
    assert "transforms.json" in str(caught.value)


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("file_path", "../outside.png", "outside"),
        ("file_path", "/etc/hostname", "outside"),
        ("file_path", "images/\0.png", "not a usable path"),
        ("file_path", "x" * 5000, "cannot be looked up|not a usable path"),
        ("file_path", 3, "expected text"),
        ("file_path", "images/view_02.png", "more than once"),
        ("mask_path", "../mask.png", "outside"),
        ("mask_path", "x" * 5000, "cannot be looked up"),
        ("depth_file_path", "../depth.png", "outside"),
        ("transform_matrix", [[float("nan")] * 4] * 4, "transform_matrix"),
        ("transform_matrix", [[1, 2], [3, 4]], "transform_matrix"),
        ("transform_matrix", np.diag([2.0, 2, 2, 1]).tolist(), "not rigid"),
        ("transform_matrix", np.diag([1.0, 1, -1, 1]).tolist(), "mirrors"),
        ("transform_matrix", np.eye(4)[:2].tolist(), "transform_matrix"),
        ("transform_matrix", [*np.eye(4)[:3].tolist(), [0, 0, 0, 2]], "transform_matrix"),
        ("transform_matrix", [*np.eye(3, 4).tolist()[:2], [0, 0, 1, 1e200]], "coordinates"),
    ],
)
def test_wrong_frames_are_named(ring, write_transforms, field, value, said):
    frames = ring.transforms()["frames"]
    frames[1][field] = value
    with pytest.raises(PocketGSError, match=said):
        open_capture(write_transforms(frames=frames))


def test_frames_without_a_pose_are_left_out(ring, write_transforms):
    """Unless most are without."""
    frames = ring.transforms()["frames"]
    frames[1]["transform_matrix"] = None
    folder = write_transforms(frames=frames)
    (folder / "images/view_02.png").unlink()
    listing = read_listing(folder)
    assert len(listing.frames) == 8
    assert [warning.partition("json: ")[2] for warning in listing.warnings] == [
        "1 of 10 listed frames have no image file, the first images/view_02.png",
        "1 of 10 listed frames have no pose, the first images/view_01.png",
    ]
    for frame in frames[3:8]:
        del frame["transform_matrix"]
    with pytest.raises(PocketGSError, match=r"frames\[1\]: field 'transform_matrix' is None"):
        read_listing(write_transforms(frames=frames))


@pytest.mark.parametrize("root", ["/home/someone/scan/", "C:\\scans\\my scan\\"])
def test_files_beside_images_that_have_moved(ring, write_transforms, root):
    frames, folder = ring.transforms()["frames"], write_transforms()
    for place, value in (("masks", 255), ("depth", 90)):
        (folder / place).mkdir()
        Image.fromarray(np.full((12, 16), value, np.uint8)).save(folder / place / "view_00.png")
    write_cloud(ring, folder / "cloud.ply")
    separator = root[-1]
    for frame, name in zip(frames, ring.names, strict=True):
        frame["file_path"] = separator.join([root[:-1], "images", name])
        frame["mask_path"] = separator.join([root[:-1], "masks", name])
        frame["depth_file_path"] = separator.join([root[:-1], "depth", name])
    capture = open_capture(write_transforms(frames=frames, ply_file_path=f"{root}cloud.ply"), hold_out=0)
    assert len(capture.points) == len(ring.positions)
    first, *others = capture.train
    assert first.mask.all()
    np.testing.assert_allclose(first.depth, 0.09)
    assert all(frame.mask is None and frame.depth is None for frame in others)
    moved, masks, depths = capture.warnings
    assert "by their names" in moved
    assert "9 of its masks" in masks
    assert "9 of its depth maps" in depths


def test_files_elsewhere_are_not_read(ring, write_transforms, tmp_path_factory):
    """Absolute paths that exist are left alone, and a photograph of the same name is no mask."""
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    Image.fromarray(np.zeros((12, 16), np.uint8)).save(elsewhere / "view_00.png")
    write_cloud(ring, elsewhere / "cloud.ply")
    frames = ring.transforms(".")["frames"]
    frames[0]["mask_path"] = frames[0]["depth_file_path"] = str(elsewhere / "view_00.png")
    folder = write_transforms(frames=frames, ply_file_path=str(elsewhere / "cloud.ply"))
    ring.write_images(folder)
    listing = read_listing(folder)
    assert (listing.frames[0].mask_path, listing.frames[0].depth_path, listing.points) == (None, None, None)
    assert len(listing.warnings) == 3


def test_nearly_rigid_poses_are_made_rigid(ring, write_transforms):
    frames = ring.transforms()["frames"]
    frames[1]["transform_matrix"][0][0] += 5e-4
    rotation = read_listing(write_transforms(frames=frames)).frames[1].camera.world_to_camera[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b"\xff\xfe{}", b"3", b"[" * 100_000, b'{"frames": 1' + b"0" * 5000]
)
def test_broken_json(tmp_path, content):
    (tmp_path / "transforms.json").write_bytes(content)
    with pytest.raises(PocketGSError, match=r"transforms\.json"):
        open_capture(tmp_path)


def test_symbolic_links_may_not_leave(write_transforms, tmp_path_factory):
    folder = write_transforms()
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "photo.png"
    elsewhere.write_bytes((folder / "images/view_01.png").read_bytes())
    (folder / "images/view_01.png").unlink()
    (folder / "images/view_01.png").symlink_to(elsewhere)
    with pytest.raises(PocketGSError, match="outside"):
        open_capture(folder)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda children: st.lists(children, max_size=4) | st.dictionaries(st.text(max_size=4), children, max_size=3),
    max_leaves=8,
)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_mutated_documents_never_crash(ring, write_transforms, data):
    document: dict[str, Any] = ring.transforms()
    document["k1"], document["test_filenames"], document["ply_file_path"] = 0.01, ["images/view_00.png"], "a.ply"
    document["frames"][0].update(w=16, h=12, mask_path="m.png", depth_file_path="d.png", depth_unit_scale_factor=1)
    target = data.draw(st.sampled_from([document, document["frames"][0], document["frames"][-1]]))
    target[data.draw(st.sampled_from(sorted(target)))] = data.draw(json_values)
    try:
        listing = read_listing(write_transforms(**document))
    except PocketGSError:
        return
    assert listing.frames


def test_photographs_that_a_file_poses_few_of(ring, write_transforms):
    """Programs write what they could place, such as two of 21."""
    frames = ring.transforms()["frames"]
    folder = write_transforms(frames=frames[:5])
    assert read_listing(folder).warnings == ()
    Image.fromarray(np.zeros((12, 16, 3), np.uint8)).save(folder / "images/more.png")
    [warning] = read_listing(folder).warnings
    assert warning == "only 5 of 11 images have a pose in transforms.json: let pocketgs pose find all anew"


def test_masks_beside_photographs_need_no_pose(ring, write_transforms):
    frames = [{**frame, "mask_path": f"images/m{index}.png"} for index, frame in enumerate(ring.transforms()["frames"])]
    folder = write_transforms(frames=frames)
    for index in range(10):
        Image.new("L", ring.images[0].shape[1::-1], 255).save(folder / f"images/m{index}.png")
    (folder / "images/view_09.png").unlink()
    assert all("have a pose" not in warning for warning in read_listing(folder).warnings)
