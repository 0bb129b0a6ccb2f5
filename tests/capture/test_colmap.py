"""The COLMAP reader and its two encodings."""

from __future__ import annotations

import contextlib
import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from pocketgs.capture import open_capture
from pocketgs.capture.formats import colmap_binary, colmap_text
from pocketgs.capture.open import read_listing
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import memory_bound

ENCODINGS = {"binary": (colmap_binary, "bin"), "text": (colmap_text, "txt")}
READERS = {"cameras": "read_cameras", "images": "read_images", "points3D": "read_points"}


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("place", ["", "sparse/0", "sparse", "colmap/sparse/0"])
def test_reads_both_encodings_in_every_place(ring, colmap_files, tmp_path, assert_same_cameras, encoding, place):
    ring.write_images(tmp_path / "images")
    colmap_files.write(tmp_path / place, encoding)
    (tmp_path / place / "rigs.bin").write_bytes(b"not looked at")
    capture = open_capture(tmp_path)
    assert capture.format == "colmap"
    frames = sorted(capture.frames, key=lambda frame: frame.name)
    assert_same_cameras([frame.camera for frame in frames], ring.cameras)
    np.testing.assert_allclose(capture.points.positions, ring.positions, rtol=1e-6)
    np.testing.assert_allclose(capture.points.colours, ring.colours / 255, rtol=1e-6)


def test_clouds_keep_to_the_memory_bound(tmp_path: Path) -> None:
    count = 200_000
    layout = [("id", "<u8"), ("position", "<f8", 3), ("colour", "u1", 3), ("error", "<f8"), ("length", "<u8")]
    records = np.zeros(count, layout)
    records["position"] = np.random.default_rng(0).random((count, 3))
    records["colour"] = np.arange(count)[:, None] % 256
    (tmp_path / "points3D.bin").write_bytes(struct.pack("<Q", count) + records.tobytes())
    tracemalloc.start()
    try:
        cloud = colmap_binary.read_points(tmp_path / "points3D.bin")
        taken = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    np.testing.assert_array_equal(cloud.positions, records["position"])
    np.testing.assert_array_equal(cloud.colours, (records["colour"] / 255).astype(np.float32))
    needed = records.nbytes + colmap_binary.POINT_BYTES * count
    assert taken < needed
    with memory_bound(needed // 1_000_000), pytest.raises(PocketGSError, match="a cloud of 200,000 points would take"):
        colmap_binary.read_points(tmp_path / "points3D.bin")


def test_names_may_hold_folders_and_spaces(ring, colmap_files, tmp_path):
    colmap_files.write(tmp_path / "sparse/0", "text")
    renamed = colmap_files.text["images"].replace("view_03.png", "left eye/view 3.png")
    (tmp_path / "sparse/0/images.txt").write_text(renamed)
    ring.write_images(tmp_path / "photos")
    (tmp_path / "photos/left eye").mkdir()
    (tmp_path / "photos/view_03.png").rename(tmp_path / "photos/left eye/view 3.png")
    capture = open_capture(tmp_path, images="photos")
    assert "photos/left eye/view 3.png" in [frame.name for frame in capture.frames]


def test_absolute_names_are_found_in_the_capture(ring, colmap_files, tmp_path):
    colmap_files.write(tmp_path / "sparse/0", "text")
    renamed = colmap_files.text["images"].replace("view_", "/data/me/photos/view_")
    (tmp_path / "sparse/0/images.txt").write_text(renamed)
    ring.write_images(tmp_path / "images")
    capture = open_capture(tmp_path)
    assert sorted(frame.name for frame in capture.frames) == [f"images/{name}" for name in ring.names]
    assert "10 of 10 were found by their names" in capture.warnings[0]


@pytest.mark.parametrize("root", ["/data/me/photos/", "C:\\me\\photos\\", "C:\\me\\images\\"])
def test_absolute_names_are_found_beside_the_model(ring, colmap_files, tmp_path, root):
    """The originals have the same names, so names alone would leave a tie."""
    colmap_files.write(tmp_path / "dense/sparse", "text")
    renamed = colmap_files.text["images"].replace("view_", f"{root}view_")
    (tmp_path / "dense/sparse/images.txt").write_text(renamed)
    for folder in ("images", "dense/images"):
        ring.write_images(tmp_path / folder)
        Image.new("RGB", (16, 12)).save(tmp_path / folder / "view_99.png")  # has no pose
    assert [frame.name for frame in read_listing(tmp_path).frames] == [f"dense/images/{name}" for name in ring.names]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_names_that_begin_with_a_number_and_a_space(ring, colmap_files, tmp_path, encoding):
    ring.write_images(tmp_path / "images")
    for path in [*(tmp_path / "images").iterdir()]:
        path.rename(path.with_name(f"2024 {path.name}"))
    colmap_files.write(tmp_path / "sparse/0", "text")
    lines = [line.replace("view_", "2024 view_") for line in colmap_files.text["images"].splitlines()]
    for text in ("\n".join(lines), "\n".join(line for line in lines if line.endswith(".png"))):
        (tmp_path / "sparse/0/images.txt").write_text(text, encoding=encoding)
        assert len(read_listing(tmp_path).frames) == 10


def test_text_takes_little_more_memory_than_its_numbers(tmp_path):
    path, count = tmp_path / "points3D.txt", 40_000
    path.write_text("".join(f"{number} {number}.5 1.25 2.5 12 34 56 0.5 1 2 3 4\n" for number in range(count)))
    size = path.stat().st_size
    tracemalloc.start()
    cloud = colmap_text.read_points(path)
    assert len(cloud) == count
    assert tracemalloc.get_traced_memory()[1] < size + 120 * count
    tracemalloc.stop()
    with memory_bound(5), pytest.raises(PocketGSError, match=r"points3D\.txt: its .* bytes of text would take 7 MB"):
        colmap_text.read_points(path)


def test_images_without_lines_of_points(ring, colmap_files, tmp_path):
    """As other programs write them, with a byte order mark besides; some images may have their points."""
    ring.write_images(tmp_path / "images")
    colmap_files.write(tmp_path / "sparse/0", "text")
    lines = [line for line in colmap_files.text["images"].splitlines() if line.endswith(".png")]
    lines.insert(5, "1.5 2 -1 3 4 -1 5 6 -1 7 8 -1")
    for text in ("\n".join(lines), "\n\n".join(lines[:5]) + "\n\n" + "\n".join(lines[6:])):
        (tmp_path / "sparse/0/images.txt").write_text(text, encoding="utf-8-sig")
        assert [Path(frame.name).name for frame in read_listing(tmp_path).frames] == ring.names


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_cameras_that_took_no_image_may_be_of_any_model(ring, colmap_files, tmp_path, encoding):
    ring.write_images(tmp_path / "images")
    colmap_files.write(tmp_path, encoding)
    if encoding == "text":
        path = tmp_path / "cameras.txt"
        path.write_text("9 FOV 16 12 20 20 8 6 0.1\n" + path.read_text())
    else:
        path = tmp_path / "cameras.bin"
        (count,) = struct.unpack_from("<Q", path.read_bytes())
        fov = struct.pack("<iiQQ5d", 9, 7, 16, 12, 20, 20, 8, 6, 0.1)
        path.write_bytes(struct.pack("<Q", count + 1) + fov + path.read_bytes()[8:])
    assert len(read_listing(tmp_path).frames) == len(ring.names)


def test_preferred_over_llff_when_complete(ring, colmap_files, tmp_path):
    ring.write_images(tmp_path / "images")
    colmap_files.write(tmp_path / "sparse/0")
    np.save(tmp_path / "poses_bounds.npy", ring.poses_bounds())
    assert open_capture(tmp_path).format == "colmap"


def test_absent_images(ring, colmap_files, tmp_path):
    colmap_files.write(tmp_path / "sparse/0")
    with pytest.raises(PocketGSError, match=r"none of the 10 registered images"):
        open_capture(tmp_path)
    with pytest.raises(PocketGSError, match=r"photos: no such folder"):
        open_capture(tmp_path, images="photos")
    ring.write_images(tmp_path / "images")
    (tmp_path / "images/view_04.png").unlink()
    assert "1 of 10 registered images" in open_capture(tmp_path).warnings[0]
    for name in ring.names:
        (tmp_path / "images" / name).unlink(missing_ok=True)
    with pytest.raises(PocketGSError, match="none of the 10 registered"):
        open_capture(tmp_path)


@pytest.mark.parametrize(("model", "images"), [("dense/sparse", "dense/images"), ("dense/0/sparse", "dense/0/images")])
def test_undistorted_images_go_with_their_model(ring, colmap_files, tmp_path, model, images):
    """COLMAP writes both to a folder of their own; the originals keep the same names."""
    colmap_files.write(tmp_path / model)
    ring.write_images(tmp_path / "images")
    assert read_listing(tmp_path).frames[0].name == "images/view_00.png"
    (tmp_path / images).mkdir()
    assert read_listing(tmp_path).frames[0].name == "images/view_00.png"
    ring.write_images(tmp_path / images)
    listing = read_listing(tmp_path)
    assert (listing.frames[0].name, listing.warnings) == (f"{images}/view_00.png", ())
    assert read_listing(tmp_path, "images").frames[0].name == "images/view_00.png"


def test_images_of_a_model_in_a_numbered_folder(ring, colmap_files, tmp_path):
    colmap_files.write(tmp_path / "colmap/sparse/0")
    for folder in ("images", "colmap/images"):
        ring.write_images(tmp_path / folder)
    assert read_listing(tmp_path).frames[0].name == "colmap/images/view_00.png"


@pytest.mark.parametrize(("first", "how"), [(0, "by the numbers in their names"), (100, "in sorted order")])
def test_renamed_copies(ring, colmap_files, tmp_path, first, how):
    """Numbers tell more than the order of the names, in which 10 comes before 2."""
    colmap_files.write(tmp_path / "sparse/0", "text")
    renamed = colmap_files.text["images"].replace("view_09.png", "IMG_10.png").replace("view_0", "IMG_")
    (tmp_path / "sparse/0/images.txt").write_text(renamed)
    order = ["IMG_0", "IMG_1", "IMG_10", *(f"IMG_{number}" for number in range(2, 9))]
    (tmp_path / "images").mkdir()
    for position, name in enumerate(order):
        number = int(name[4:]) if first == 0 else first + position
        Image.new("RGB", (16, 12)).save(tmp_path / f"images/image{number:03d}.png")
    capture = open_capture(tmp_path, hold_out=0)
    assert capture.warnings == (f"images names its files otherwise: matched to the model {how}",)
    expected = [9, 2] if first == 0 else [3, 4]
    chosen = ("image010.png", "image002.png") if first == 0 else ("image104.png", "image105.png")
    cameras = {Path(frame.name).name: frame.camera for frame in capture.frames}
    for name, index in zip(chosen, expected, strict=True):
        np.testing.assert_allclose(cameras[name].world_to_camera, ring.cameras[index].world_to_camera, atol=1e-9)


@pytest.mark.parametrize(
    ("line", "model", "coefficients"),
    [
        ("SIMPLE_PINHOLE 16 12 20 8 6", "opencv", ()),
        ("SIMPLE_RADIAL 16 12 20 8 6 0.1", "opencv", (0.1, 0, 0, 0, 0, 0, 0, 0)),
        ("RADIAL 16 12 20 8 6 0.1 0.2", "opencv", (0.1, 0.2, 0, 0, 0, 0, 0, 0)),
        ("OPENCV 16 12 20 20 8 6 0.1 0.2 0.3 0.4", "opencv", (0.1, 0.2, 0.3, 0.4, 0, 0, 0, 0)),
        ("FULL_OPENCV 16 12 20 20 8 6 1 2 3 4 5 6 7 8", "opencv", (1, 2, 3, 4, 5, 6, 7, 8)),
        ("OPENCV_FISHEYE 16 12 20 20 8 6 1 2 3 4", "fisheye", (1, 2, 3, 4)),
        ("SIMPLE_RADIAL_FISHEYE 16 12 20 8 6 0.1", "fisheye", (0.1, 0, 0, 0)),
        ("RADIAL_FISHEYE 16 12 20 8 6 0.1 0.2", "fisheye", (0.1, 0.2, 0, 0)),
    ],
)
def test_camera_models(tmp_path, line, model, coefficients):
    (tmp_path / "cameras.txt").write_text(f"3 {line}\n")
    camera = colmap_text.read_cameras(tmp_path / "cameras.txt")[3]
    assert (camera.width, camera.height, camera.focal, camera.centre) == (16, 12, (20, 20), (8, 6))
    assert (camera.lens.model, camera.lens.coefficients) == (model, coefficients)


@pytest.mark.parametrize(
    ("part", "content", "said"),
    [
        ("cameras", "3 FOV 16 12 20 20 8 6 0.1", "camera model FOV"),
        ("cameras", "3 PINHOLE 16 12 20", "4 parameters"),
        ("cameras", "3 PINHOLE 16", "CAMERA_ID"),
        ("cameras", "3 PINHOLE 16 12 20 nan 8 6", "finite"),
        ("cameras", "3 PINHOLE -16 12 20 20 8 6", "image size"),
        ("cameras", "3 PINHOLE 99999999999 12 20 20 8 6", "image size"),
        ("cameras", "4 PINHOLE 16 12 20 20 8 6", "camera 3"),
        ("cameras", b"\xff\xfe", "UTF-8"),
        ("images", "1 1 0 0 0 nan 0 0 3 view_00.png\n\n", "NaN"),
        ("images", "1 0 0 0 0 0 0 0 3 view_00.png\n\n", "quaternion"),
        ("images", "1 1 0 0 0 0 0 0 3 ../../view_00.png\n\n", "outside"),
        ("images", "1 1 0 0 0 0 0 3 view_00.png\n\n", "IMAGE_ID|whole numbers"),
        ("images", "1 1 0 0 0 0 0 0 3 view_00.png\n\n" * 2, "more than once"),
        ("images", "# none\n", "registers no image"),
        ("points3D", "1 0 0 nan 0 0 0 0", "NaN"),
        ("points3D", "1 0 0 x 0 0 0 0", "expected numbers"),
        ("points3D", "1 0 0", "POINT_ID"),
    ],
)
def test_wrong_text(ring, colmap_files, tmp_path, part, content, said):
    colmap_files.write(tmp_path, "text")
    ring.write_images(tmp_path / "images")
    (tmp_path / f"{part}.txt").write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(PocketGSError, match=said):
        open_capture(tmp_path)


@pytest.mark.parametrize("part", READERS)
def test_binary_files_cut_at_every_length(colmap_files, tmp_path, part):
    path, whole = tmp_path / f"{part}.bin", colmap_files.binary[part]
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with pytest.raises(PocketGSError, match=rf"{part}\.bin"):
            getattr(colmap_binary, READERS[part])(path)


@pytest.mark.parametrize("part", READERS)
def test_huge_counts_are_refused(tmp_path, part):
    path = tmp_path / f"{part}.bin"
    path.write_bytes(struct.pack("<Q", 2**63) + bytes(200))
    with pytest.raises(PocketGSError, match=r"more than its 208 bytes can hold: was it copied as a whole\?"):
        getattr(colmap_binary, READERS[part])(path)


def test_unknown_binary_model(tmp_path):
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<QiiQQ5d", 1, 1, 7, 16, 12, 20, 20, 8, 6, 0.1))
    with pytest.raises(PocketGSError, match="camera model number 7"):
        colmap_binary.read_cameras(tmp_path / "cameras.bin")


@pytest.mark.parametrize("encoding", ENCODINGS)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_models_never_crash(ring, colmap_files, tmp_path: Path, encoding, data):
    colmap_files.write(tmp_path, encoding)
    (tmp_path / "images").mkdir(exist_ok=True)
    ring.write_images(tmp_path / "images")
    part = data.draw(st.sampled_from(sorted(READERS)))
    path = tmp_path / f"{part}.{ENCODINGS[encoding][1]}"
    whole = path.read_bytes()
    position = data.draw(st.integers(0, len(whole)))
    inserted = data.draw(st.binary(max_size=16))
    removed = data.draw(st.integers(0, 16))
    path.write_bytes(whole[:position] + inserted + whole[position + removed :])
    with contextlib.suppress(PocketGSError):
        assert read_listing(tmp_path).frames


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("part", READERS)
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=200))
def test_random_bytes_never_crash(tmp_path, encoding, part, content):
    reader, suffix = ENCODINGS[encoding]
    path = tmp_path / f"{part}.{suffix}"
    path.write_bytes(content)
    with contextlib.suppress(PocketGSError):
        getattr(reader, READERS[part])(path)
