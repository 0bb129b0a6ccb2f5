"""Features: where they are found to a fraction of a pixel, where they are not, and which match."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.cpu.finder import CpuFinder
from pocketgs.prior.features.features import Features

WIDTH, HEIGHT = 160, 120
MOST = 2000
FINDER = CpuFinder()


def frame_of(grey: np.ndarray, alpha: np.ndarray | None = None, mask: np.ndarray | None = None) -> Frame:
    height, width = grey.shape
    image = np.repeat(np.rint(np.clip(grey, 0, 255)).astype(np.uint8)[:, :, None], 3, axis=2)
    return Frame("0.png", Camera(width, height, 150.0, 150.0, width / 2, height / 2, np.eye(4)), image, alpha, mask)


def texture(shift: tuple[float, float] = (0.0, 0.0), seed: int = 0) -> np.ndarray:
    """(H, W) blurred noise, moved right and down by any number of pixels: exactly, by its Fourier transform."""
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(HEIGHT, WIDTH)), (0, 0), 1.5)
    phase = np.fft.fftfreq(WIDTH) * shift[0] + np.fft.fftfreq(HEIGHT)[:, None] * shift[1]
    return 128 + 250 * np.fft.ifft2(np.fft.fft2(noise) * np.exp(-2j * np.pi * phase)).real


def random_features(count: int, seed: int = 0) -> Features:
    rng = np.random.default_rng(seed)
    descriptors = np.abs(rng.normal(size=(count, 128)))
    lengths = np.linalg.norm(descriptors, axis=1, keepdims=True)
    return Features(rng.uniform(0, 100, (count, 2)), (descriptors / lengths).astype(np.float32))


@pytest.mark.parametrize("scale", [1.6, 2.5, 5.0])
def test_blobs_are_found_where_they_are(scale: float) -> None:
    centres = np.array([[40.5, 40.5], [100.25, 40.8], [40.9, 90.1], [110.0, 85.0]])
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    squares = (columns[:, :, None] - centres[:, 0]) ** 2 + (rows[:, :, None] - centres[:, 1]) ** 2
    found = FINDER.detect(frame_of(50 + 150 * np.exp(-squares / (2 * scale**2)).sum(axis=2)), MOST).pixels
    for centre in centres:
        np.testing.assert_allclose(found[np.linalg.norm(found - centre, axis=1).argmin()], centre, atol=0.1)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.3, -0.45), (5.25, 2.6), (-7.5, 0.5)])
def test_matches_of_a_shifted_image_tell_the_shift(shift: tuple[float, float]) -> None:
    first, second = FINDER.detect(frame_of(texture()), MOST), FINDER.detect(frame_of(texture(shift)), MOST)
    pairs = FINDER.match(first, second)
    moved = second.pixels[pairs[:, 1]] - first.pixels[pairs[:, 0]]
    assert len(pairs) > 100
    np.testing.assert_allclose(np.median(moved, axis=0), shift, atol=0.03)
    assert np.mean(np.linalg.norm(moved - shift, axis=1) < 0.1) > 0.8


@pytest.mark.parametrize("by", ["alpha", "mask", "both"])
def test_what_is_masked_has_no_features(by: str) -> None:
    alpha, mask = np.full((HEIGHT, WIDTH), 255, np.uint8), np.ones((HEIGHT, WIDTH), bool)
    mask[:, :80] = by == "alpha"
    alpha[60:] = 255 if by == "mask" else 0
    columns, rows = FINDER.detect(frame_of(texture(), alpha, mask), MOST).pixels.astype(int).T
    assert len(columns) > 50
    assert mask[rows, columns].all()
    assert np.all(alpha[rows, columns] == 255)


def test_masked_out_altogether() -> None:
    assert len(FINDER.detect(frame_of(texture(), mask=np.zeros((HEIGHT, WIDTH), bool)), MOST).pixels) == 0


@pytest.mark.parametrize("size", [(HEIGHT, WIDTH), (3, 5), (1, 1)])
@pytest.mark.parametrize("level", [0, 128, 255])
def test_an_even_image_has_no_features(level: int, size: tuple[int, int]) -> None:
    nothing = FINDER.detect(frame_of(np.full(size, level)), MOST)
    assert nothing.pixels.shape == (0, 2)
    assert nothing.descriptors.shape == (0, 128)
    something = random_features(50)
    for pair in ((nothing, something), (something, nothing), (nothing, nothing)):
        assert FINDER.match(*pair).shape == (0, 2)


def test_the_strongest_features_are_kept() -> None:
    many, few = FINDER.detect(frame_of(texture()), MOST), FINDER.detect(frame_of(texture()), 40)
    assert len(few.pixels) <= 41  # equally strong ones are kept together: those of one place that differ in direction
    assert {tuple(pixel) for pixel in few.pixels} <= {tuple(pixel) for pixel in many.pixels}


def test_descriptors_have_length_one() -> None:
    descriptors = FINDER.detect(frame_of(texture()), MOST).descriptors
    assert descriptors.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(descriptors, axis=1), 1.0, atol=1e-5)


def test_matches_are_each_others_nearest() -> None:
    first, second = FINDER.detect(frame_of(texture()), MOST), FINDER.detect(frame_of(texture((3.3, 1.8))), MOST)
    pairs, turned = FINDER.match(first, second), FINDER.match(second, first)[:, ::-1]
    alike = first.descriptors.astype(float) @ second.descriptors.T
    for one, other in pairs:
        assert alike[one, other] >= max(alike[one].max(), alike[:, other].max()) - 1e-6
    both = np.unique(np.concatenate([pairs, turned]), axis=0)
    assert all(len(np.unique(both[:, side])) == len(both) for side in (0, 1))


def test_matching_undoes_a_shuffle() -> None:
    first = random_features(200)
    order = np.random.default_rng(1).permutation(200)
    pairs = FINDER.match(first, Features(first.pixels[order], first.descriptors[order]))
    np.testing.assert_array_equal(order[pairs[:, 1]], pairs[:, 0])
    assert len(pairs) == 200


def test_what_looks_like_two_others_matches_neither() -> None:
    first, other = random_features(30), random_features(30, seed=1)
    like = first.descriptors + 0.1 * other.descriptors
    twice = Features(np.repeat(first.pixels, 2, axis=0), np.repeat(like, 2, axis=0) / 1.1)
    assert len(FINDER.match(first, Features(first.pixels, like / 1.1))) == 30
    assert len(FINDER.match(first, twice)) == 0
