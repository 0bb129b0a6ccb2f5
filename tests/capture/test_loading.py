"""Decoding images and bringing them to their final size."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from pocketgs.capture.decoding.image_file import read_colour, read_size
from pocketgs.capture.decoding.mask_file import read_mask
from pocketgs.capture.frame_parts import composite
from pocketgs.capture.listing import FrameSource
from pocketgs.capture.loading import Preparation, load_frame
from pocketgs.capture.stored_photographs import StoredPhotographs
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera


@pytest.fixture
def source(tmp_path: Path) -> FrameSource:
    """A frame of 38x29 random pixels."""
    image = np.random.default_rng(1).integers(0, 256, (29, 38, 3), dtype=np.uint8)
    Image.fromarray(image).save(tmp_path / "a.png")
    return FrameSource("a.png", tmp_path / "a.png", Camera(38, 29, 30.0, 31.0, 19.5, 14.0, np.eye(4)))


def with_extras(source: FrameSource) -> FrameSource:
    folder = source.image.parent
    mask = np.zeros((29, 38), dtype=np.uint8)
    mask[:6, :3] = 1
    Image.fromarray(mask).save(folder / "mask.png")
    np.save(folder / "depth.npy", np.arange(29 * 38, dtype=np.float32).reshape(29, 38))
    return FrameSource(
        "a.png", source.image, source.camera, mask_path=folder / "mask.png", depth_path=folder / "depth.npy"
    )


def test_downscaling_averages_whole_blocks(source):
    frame = load_frame(source, Preparation(downscale=4))
    full = np.asarray(Image.open(source.image)).astype(float)
    blocks = full[:28, :36].reshape(7, 4, 9, 4, 3).mean(axis=(1, 3))
    assert np.abs(frame.image - blocks).max() <= 0.5
    camera = frame.camera
    assert (camera.width, camera.height, camera.fx, camera.cx, camera.cy) == (9, 7, 7.5, 19.5 / 4, 3.5)


@pytest.mark.parametrize(
    ("preparation", "size"),
    [
        (Preparation(), (38, 29)),
        (Preparation(downscale=1.5), (25, 19)),
        (Preparation(max_size=20), (20, 15)),
        (Preparation(max_size=100), (38, 29)),
        (Preparation(downscale=2, max_size=10), (10, 7)),
    ],
)
def test_sizes_and_intrinsics_agree(source, preparation, size):
    frame = load_frame(source, preparation)
    width, height = size
    assert frame.image.shape == (height, width, 3)
    assert (frame.camera.width, frame.camera.height) == size
    # The same ray meets the same part of the picture, up to the rows and columns that were cropped away.
    ray = np.array([[0.1, -0.2, 1.0]])
    before, after = source.camera.project(ray)[0], frame.camera.project(ray)[0]
    cropped = (38, 28) if preparation.downscale == 2 else (38, 29)
    np.testing.assert_allclose(after / size, before / cropped, rtol=1e-12)


def test_masks_go_by_majority_and_depths_by_the_block_centre(source):
    frame = load_frame(with_extras(source), Preparation(downscale=4))
    assert frame.mask[0, 0]
    assert frame.mask.sum() == 1
    np.testing.assert_allclose(frame.depth[1, 2], (6 * 38 + 10) * 0.001)
    assert (frame.mask.shape, frame.depth.shape) == ((7, 9), (7, 9))


def test_file_of_another_size_scales_the_camera(source, tmp_path):
    Image.fromarray(np.zeros((58, 76, 3), dtype=np.uint8)).save(tmp_path / "a.png")
    camera = load_frame(source, Preparation()).camera
    assert (camera.width, camera.fx, camera.cy) == (76, 60.0, 28.0)
    Image.fromarray(np.zeros((38, 29, 3), dtype=np.uint8)).save(tmp_path / "a.png")
    with pytest.raises(PocketGSError, match=r"a\.png: image of 29x38 pixels, expected the shape of its camera, 38x29"):
        load_frame(source, Preparation())


def test_too_small_to_downscale(source):
    with pytest.raises(PocketGSError, match=r"a\.png: 38x29 pixels cannot be downscaled by 100"):
        load_frame(source, Preparation(downscale=100))


@pytest.mark.parametrize("background", [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.2, 0.5, 0.9)])
def test_composite(background):
    alpha, grey = np.mgrid[:256, :256].astype(np.uint8)
    colours = np.repeat(grey[:, :, None], 3, axis=2)
    behind = np.array(background) * 255
    expected = behind + (colours - behind) * (alpha[:, :, None] / 255.0)
    assert np.abs(composite(colours, alpha, background) - expected).max() <= 0.5 + 1e-4


def test_kinds_of_image(tmp_path):
    ramp = np.arange(0, 240, 10, dtype=np.uint8).reshape(4, 6)
    grey = Image.fromarray(ramp)
    sixteen = Image.fromarray(ramp.astype(np.uint16) * 257)
    images = {"L": grey, "16": sixteen, "P": grey.convert("P"), "RGB": grey.convert("RGB"), "1": grey.convert("1")}
    for name, image in images.items():
        image.save(tmp_path / f"{name}.png")
        colours, alpha = read_colour(tmp_path / f"{name}.png")
        assert (colours.shape, colours.dtype, alpha) == ((4, 6, 3), np.uint8, None)
        if name != "1":
            np.testing.assert_array_equal(colours[:, :, 1], ramp)
    for mode in ("LA", "RGBA"):
        cut_out = grey.convert(mode)
        cut_out.putalpha(grey)
        cut_out.save(tmp_path / f"{mode}.png")
        np.testing.assert_array_equal(read_colour(tmp_path / f"{mode}.png")[1], ramp)
    grey.convert("CMYK").save(tmp_path / "cmyk.jpg")
    assert read_colour(tmp_path / "cmyk.jpg")[0].shape == (4, 6, 3)
    assert read_mask(tmp_path / "16.png").sum() == 11  # of 130 to 230, above half of white


def test_orientation_tag_is_not_applied(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.new("RGB", (8, 4)).save(tmp_path / "a.jpg", exif=exif)
    assert read_colour(tmp_path / "a.jpg")[0].shape == (4, 8, 3)


def test_missing_and_huge_images(tmp_path, monkeypatch):
    with pytest.raises(PocketGSError, match=r"a\.png: no such file"):
        read_colour(tmp_path / "a.png")
    Image.new("RGB", (100, 100)).save(tmp_path / "a.png")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 10)
    with pytest.raises(PocketGSError, match=r"a\.png: has more than 250,000,000 pixels; reduce it"):
        read_colour(tmp_path / "a.png")


@pytest.mark.filterwarnings("ignore::PIL.Image.DecompressionBombWarning")
def test_photographs_of_200_megapixels(tmp_path):
    """The largest that phones take are refused for the memory that they need, which the user can allow."""
    path = tmp_path / "a.png"
    Image.new("1", (16320, 12240)).save(path)
    assert read_size(path) == (16320, 12240)
    with pytest.raises(PocketGSError, match=r"a\.png: 16320x12240 pixels .* --max-memory 4795 or more"):
        read_colour(path)


@pytest.mark.parametrize("suffix", ["png", "jpg", "webp"])
def test_truncated_images(tmp_path, suffix):
    buffer = io.BytesIO()
    noise = np.random.default_rng(0).integers(0, 256, (16, 16, 3), dtype=np.uint8)
    Image.fromarray(noise).save(buffer, {"jpg": "JPEG"}.get(suffix, suffix))
    whole = buffer.getvalue()
    path = tmp_path / f"a.{suffix}"
    for length in range(0, len(whole) - 20, 5):
        path.write_bytes(whole[:length])
        with pytest.raises(PocketGSError, match="cannot be decoded"):
            read_colour(path)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(position=st.integers(0, 400), replacement=st.binary(min_size=1, max_size=8))
def test_damaged_images_never_crash(source, position, replacement):
    whole = source.image.read_bytes()
    damaged = source.image.with_name("damaged.png")
    damaged.write_bytes(whole[:position] + replacement + whole[position + len(replacement) :])
    with contextlib.suppress(PocketGSError):
        assert read_colour(damaged)[0].ndim == 3


def test_stored_photographs_are_seen_at_any_size(source: FrameSource) -> None:
    photographs = StoredPhotographs([source], Preparation(downscale=4, max_size=5))
    assert photographs.longest_side == 38
    assert photographs.map(lambda frame: frame.image.shape, 100) == {"a.png": (29, 38, 3)}
    assert photographs.map(lambda frame: (frame.camera.width, frame.camera.height), 20) == {"a.png": (20, 15)}
