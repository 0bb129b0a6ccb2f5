"""Features on the GPU are OpenCV's: as many, at the same places, with the same descriptors, and the same ones match."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pocketgs.capture import Capture, open_capture
from pocketgs.capture.capture import Frame
from pocketgs.prior.exposure import exposure_gains
from pocketgs.prior.features.cpu.finder import CpuFinder
from pocketgs.prior.features.detection import detect_all
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.webgpu.finder import WebGpuFinder
from pocketgs.prior.features.webgpu.layout import MOST_OCTAVES, OCTAVE_BYTES, PIXEL_BYTES
from pocketgs.prior.poses.structure import StructureSettings, build_structure
from pocketgs.prior.scale import estimate_scale
from prior.features.test_finder import frame_of, random_features, texture

pytestmark = pytest.mark.usefixtures("adapter")

MOST = 300
LARGEST_BINDING = 128 << 20
"""Bytes that every device with WebGPU allows."""


@pytest.fixture(scope="module")
def finder() -> WebGpuFinder:
    return WebGpuFinder()


@pytest.fixture(scope="module")
def fern(data_folder: Path) -> Capture:
    return open_capture(data_folder / "fern", images="images_8", downscale=2)


def shares_found(found: Features, expected: Features) -> tuple[float, float]:
    """Shares of the expected features that were found within 0.01 pixels, and of those, with the same descriptor.

    A place can have several features, one for each direction of strong gradients.
    """
    distances, nearest = cKDTree(found.pixels).query(expected.pixels, k=4)
    near = distances < 0.01
    products = np.einsum("ij,ikj->ik", expected.descriptors, found.descriptors[np.where(near, nearest, 0)])
    return float(near.any(axis=1).mean()), float((np.where(near, products, -1).max(axis=1) > 0.999).mean())


def assert_same(found: Features, expected: Features) -> None:
    assert len(found.pixels) == pytest.approx(len(expected.pixels), abs=max(2, 0.01 * len(expected.pixels)))
    places, descriptors = shares_found(found, expected)
    assert places > 0.98
    assert descriptors > 0.97
    np.testing.assert_allclose(np.linalg.norm(found.descriptors, axis=1), 1, atol=1e-5)


def masked(image: np.ndarray) -> Frame:
    height, width = image.shape
    alpha, mask = np.full((height, width), 255, np.uint8), np.ones((height, width), bool)
    alpha[: height // 3] = 0
    mask[:, : width // 2] = False
    return frame_of(image, alpha, mask)


@pytest.mark.parametrize("most", [MOST, 40])
def test_photographs(finder: WebGpuFinder, fern: Capture, most: int) -> None:
    for frame in fern.train[:2]:
        assert_same(finder.detect(frame, most), CpuFinder().detect(frame, most))


@pytest.mark.parametrize("image", [texture(), texture()[:71, :93], texture()[:40, :159]])
def test_odd_sizes(finder: WebGpuFinder, image: np.ndarray) -> None:
    assert_same(finder.detect(frame_of(image), MOST), CpuFinder().detect(frame_of(image), MOST))


def test_masks(finder: WebGpuFinder) -> None:
    frame = masked(texture())
    found = finder.detect(frame, MOST)
    assert_same(found, CpuFinder().detect(frame, MOST))
    columns, rows = found.pixels.astype(int).T
    assert frame.usable is not None
    assert frame.usable[rows, columns].all()


@pytest.mark.parametrize("size", [(60, 80), (11, 200), (3, 5), (1, 1)])
def test_nothing_to_see(finder: WebGpuFinder, size: tuple[int, int]) -> None:
    found = finder.detect(frame_of(np.full(size, 128)), MOST)
    assert found.pixels.shape == (0, 2)
    assert found.descriptors.shape == (0, 128)


def test_the_same_twice(finder: WebGpuFinder, fern: Capture) -> None:
    """Threads of the GPU find features in any order."""
    first, second = (finder.detect(fern.train[0], MOST) for _ in range(2))
    np.testing.assert_array_equal(first.pixels, second.pixels)
    np.testing.assert_array_equal(first.descriptors, second.descriptors)


@pytest.mark.parametrize(("first", "second"), [(50, 33), (16, 17), (2, 200), (1, 9), (9, 0)])
def test_matches(finder: WebGpuFinder, first: int, second: int) -> None:
    """Of descriptors that resemble some of the others."""
    own = random_features(first, 1)
    others = random_features(second, 2)
    near = min(first, second)
    blend = 0.9 * own.descriptors[:near] + 0.1 * others.descriptors[:near]
    others.descriptors[:near] = blend / np.linalg.norm(blend, axis=1, keepdims=True)
    for pair in ((own, others), (others, own)):
        np.testing.assert_array_equal(finder.match(*pair), CpuFinder().match(*pair))


def test_structure_is_the_cpus(finder: WebGpuFinder, clean_walk: Capture) -> None:
    """Points, poses, and gains of exposure, from features of either device."""
    capture, settings = replace(clean_walk, train=clean_walk.train[:5], held_out=[]), StructureSettings(features=MOST)
    scale = estimate_scale(capture)
    found, expected = (build_structure(capture.train, scale, settings, None, one) for one in (finder, CpuFinder()))
    assert found is not None
    assert expected is not None
    assert len(found.points) == pytest.approx(len(expected.points), rel=0.02)
    assert found.rmse_after == pytest.approx(expected.rmse_after, rel=0.03)
    gains, others = (exposure_gains(capture.train, one, scale) for one in (found, expected))
    np.testing.assert_allclose(gains, others, rtol=5e-3)


def sizes(finder: WebGpuFinder) -> Sequence[int]:
    return list(finder.finding.sizes().values())


def test_images_are_reduced_to_what_memory_holds(fern: Capture) -> None:
    finder = WebGpuFinder(max_memory=11)
    found = detect_all(fern.train[:1], 2000, finder)[0]
    assert sum(sizes(finder)) < 11_000_000
    assert found.grain > 1.1
    finder.release()
    assert sum(sizes(finder)) < 100


def test_what_memory_is_planned_by() -> None:
    """The bytes per pixel are at least those of the buffers, for images of any shape."""
    for width, height in ((1280, 960), (960, 1280), (1180, 1180), (1280, 300)):
        description = WebGpuFinder().finding.description
        symbols = description.symbols({"width": width, "height": height, "chosen": 2000})
        assert symbols["octaves"] <= MOST_OCTAVES
        bytes_of = description.sizes(symbols, description.buffers)
        pixels = width * height
        assert max(bytes_of.values()) <= OCTAVE_BYTES * pixels
        assert sum(bytes_of.values()) <= PIXEL_BYTES * pixels + 2_000_000
        if pixels <= LARGEST_BINDING // OCTAVE_BYTES:
            assert max(bytes_of.values()) <= LARGEST_BINDING
