"""PSNR and SSIM against scikit-image, colour correction, masks, and FLIP and LPIPS with and without their packages."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage import data
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from pocketgs.errors import PocketGSError
from pocketgs.metrics.colour_correction import colour_corrected
from pocketgs.metrics.evaluation import Evaluation, ImageMetrics, Pair, cc_psnr, evaluate, psnr, ssim
from pocketgs.metrics.flip import flip
from pocketgs.metrics.perceptual import Lpips


def reference_ssim(first: np.ndarray, second: np.ndarray) -> float:
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    return structural_similarity(first, second, channel_axis=2, data_range=1, **options)


def noisy(image: np.ndarray, amount: float, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, amount, image.shape)
    return np.clip(image + noise, 0, 1).astype(np.float32)


@pytest.fixture(scope="module")
def photo() -> np.ndarray:
    return data.astronaut()[40:200, 120:330].astype(np.float32) / 255


@pytest.mark.parametrize("amount", [0.001, 0.02, 0.1, 0.5])
def test_agrees_with_scikit_image_on_a_photograph(photo: np.ndarray, amount: float) -> None:
    rendered = noisy(photo, amount)
    assert ssim(rendered, photo) == pytest.approx(reference_ssim(rendered, photo), abs=1e-4)
    assert psnr(rendered, photo) == pytest.approx(peak_signal_noise_ratio(photo, rendered, data_range=1), abs=1e-4)


@settings(max_examples=30)
@given(height=st.integers(11, 40), width=st.integers(11, 40), seed=st.integers(0, 1000), amount=st.floats(0, 1))
def test_agrees_with_scikit_image_at_any_size(height: int, width: int, seed: int, amount: float) -> None:
    image = np.random.default_rng(seed).random((height, width, 3), dtype=np.float32)
    rendered = noisy(image, amount, seed)
    assert ssim(rendered, image) == pytest.approx(reference_ssim(rendered, image), abs=1e-4)


def test_identical_images_are_finite(photo: np.ndarray) -> None:
    assert psnr(photo, photo) == pytest.approx(100)
    assert ssim(photo, photo) == pytest.approx(1)


def test_mask_hides_what_lies_outside(photo: np.ndarray) -> None:
    rendered = noisy(photo, 0.05)
    mask = np.zeros(photo.shape[:2], dtype=bool)
    mask[30:90, 40:150] = True
    spoilt = rendered.copy()
    spoilt[100:] = 0
    assert psnr(spoilt, photo, mask) == psnr(rendered, photo, mask)
    assert ssim(spoilt, photo, mask) == pytest.approx(ssim(rendered, photo, mask))
    # Nor does anything right beside the mask count, in either image.
    elsewhere = np.where(mask[:, :, None], photo, noisy(photo, 0.5))
    assert ssim(np.where(mask[:, :, None], rendered, 1), elsewhere, mask) == ssim(rendered, photo, mask)
    assert psnr(rendered, elsewhere, mask) == psnr(rendered, photo, mask)
    inside = photo[30:90, 40:150]
    assert psnr(rendered, photo, mask) == pytest.approx(psnr(rendered[30:90, 40:150], inside))


def test_colour_correction_undoes_a_camera_s_own_colours(photo: np.ndarray) -> None:
    mixed = np.clip(photo @ [[0.8, 0.05, 0.0], [0.0, 0.9, 0.1], [0.02, 0.0, 1.1]] + 0.02, 0, 1).astype(np.float32)
    curved = np.clip(0.9 * photo + 0.08 * photo**2, 0, 1).astype(np.float32)
    for rendered in (mixed, curved):
        assert psnr(rendered, photo) < 33
        assert cc_psnr(rendered, photo) > 38
    noise = noisy(photo, 0.01)
    assert 0 <= cc_psnr(noise, photo) - psnr(noise, photo) < 1


def test_colour_correction_forgives_nothing_but_colours(photo: np.ndarray) -> None:
    shifted = np.roll(photo, 8, axis=1)
    assert cc_psnr(shifted, photo) < psnr(shifted, photo) + 3


@pytest.mark.parametrize("level", [0.0, 1.0])
def test_colour_correction_of_what_is_clipped_everywhere(photo: np.ndarray, level: float) -> None:
    flat = np.full_like(photo, level)
    assert cc_psnr(flat, photo) == pytest.approx(psnr(flat, photo))
    assert cc_psnr(photo, flat) == pytest.approx(psnr(photo, flat))


def multinerf_correction(rendered: np.ndarray, photo: np.ndarray) -> np.ndarray:
    """MultiNeRF's colour correction, written as its definition."""

    def unclipped(values: np.ndarray) -> np.ndarray:
        return (values >= 0.5 / 255) & (values <= 1 - 0.5 / 255)

    pixels, target = rendered.reshape(-1, 3).astype(np.float64), photo.reshape(-1, 3).astype(np.float64)
    at_first = unclipped(pixels)
    for _ in range(5):
        quadratic = [pixels[:, [a]] * pixels[:, [b]] for a in range(3) for b in range(a, 3)]
        terms = np.concatenate([*quadratic, pixels, np.ones_like(pixels[:, :1])], axis=1)
        fitted = []
        for channel in range(3):
            counts = at_first[:, channel] & unclipped(pixels[:, channel]) & unclipped(target[:, channel])
            fitted.append(terms @ np.linalg.lstsq(terms[counts], target[counts, channel], rcond=None)[0])
        pixels = np.clip(np.stack(fitted, axis=1), 0, 1)
    return pixels.reshape(rendered.shape)


def test_colour_correction_is_multinerfs(photo: np.ndarray) -> None:
    """Also where the correction itself clips pixels, which later rounds leave out."""
    steep = np.clip(3 * photo - 1, 0, 1)
    rendered = noisy(0.4 * photo + 0.3, 0.03)
    expected = multinerf_correction(rendered, steep)
    assert ((expected == 0) | (expected == 1)).any(axis=2).mean() > 0.2
    np.testing.assert_allclose(colour_corrected(rendered, steep), expected, atol=1e-3)


def test_colours_are_fitted_within_the_mask(photo: np.ndarray) -> None:
    mask = np.zeros(photo.shape[:2], dtype=bool)
    mask[30:90, 40:150] = True
    rendered = np.where(mask[:, :, None], 0.8 * photo, 1 - photo).astype(np.float32)
    assert cc_psnr(rendered, photo, mask) > 40
    assert cc_psnr(rendered, photo) < 30


def test_colour_correction_leaves_the_background_of_an_object_alone(photo: np.ndarray) -> None:
    """Black is clipped, so nothing would keep a fit from tinting it."""
    visible = np.zeros(photo.shape[:2], dtype=bool)
    visible[30:90, 40:150] = True
    cut = np.where(visible[..., None], photo, np.float32(0.0))
    darker = np.clip(0.9 * cut - 0.05, 0, 1)
    assert cc_psnr(darker, cut) < 30
    assert cc_psnr(darker, cut, None, visible) > 40
    tinted = np.where(visible[..., None], cut, np.float32(0.1))
    assert cc_psnr(tinted, cut, None, visible) == pytest.approx(psnr(tinted, cut), abs=1e-3)
    assert cc_psnr(tinted, cut, visible, visible) > 60
    for other in (visible[:3], visible[..., None], visible.astype(np.uint8)):
        with pytest.raises(PocketGSError, match="visible is"):
            cc_psnr(tinted, cut, None, other)


def test_flip_grows_with_the_error(photo: np.ndarray) -> None:
    pytest.importorskip("flip_evaluator")
    found = [flip(noisy(photo, amount), photo) for amount in (0.01, 0.05, 0.2)]
    assert flip(photo, photo) == 0
    assert all(value is not None and 0 < value < 1 for value in found)
    assert found == sorted(found, key=lambda value: value or 0.0)
    mask = np.zeros(photo.shape[:2], dtype=bool)
    mask[:80] = True
    spoilt = photo.copy()
    spoilt[80:] = 0
    assert flip(spoilt, photo, mask) == 0


def test_flip_is_the_mean_over_the_mask_alone(monkeypatch: pytest.MonkeyPatch, photo: np.ndarray) -> None:
    """With a package that measures absolute differences of the images that it is given."""

    def evaluate_pair(
        reference: np.ndarray, test: np.ndarray, *_: object, **__: object
    ) -> tuple[np.ndarray, None, None]:
        return np.abs(reference - test).mean(axis=2, keepdims=True), None, None

    monkeypatch.setitem(sys.modules, "flip_evaluator", SimpleNamespace(evaluate=evaluate_pair))
    mask = np.zeros(photo.shape[:2], dtype=bool)
    mask[20:60, 30:90] = True
    rendered = np.where(mask[..., None], 0.75 * photo, 1.0 - photo)
    assert flip(rendered, photo, mask) == pytest.approx(0.25 * photo[mask].mean(), rel=1e-5)
    assert flip(rendered, photo) == pytest.approx(np.abs(rendered - photo).mean(), rel=1e-5)


def test_missing_flip_is_none(monkeypatch: pytest.MonkeyPatch, photo: np.ndarray) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    assert evaluate([Pair("a", photo, photo)], with_lpips=False).flip is None


def test_full_mask_changes_nothing(photo: np.ndarray) -> None:
    rendered, everything = noisy(photo, 0.05), np.ones(photo.shape[:2], dtype=bool)
    assert psnr(rendered, photo, everything) == pytest.approx(psnr(rendered, photo))
    assert ssim(rendered, photo, everything) == pytest.approx(ssim(rendered, photo))


GREY = np.full((20, 20, 3), 0.5, np.float32)


@pytest.mark.parametrize(
    ("rendered", "photo", "mask", "message"),
    [
        (GREY[:15], GREY, None, "expected the same"),
        (GREY[..., 0], GREY, None, "expected \\(height, width, 3\\)"),
        (GREY, (GREY * 255).astype(np.uint8), None, "photo has type uint8"),
        (GREY * np.nan, GREY, None, "not finite"),
        (GREY, GREY * 255, None, "photo has values from 127.5 to 127.5, expected RGB in \\[0, 1\\]"),
        (GREY, GREY - 1, None, "photo has values from -0.5 to -0.5"),
        ((GREY * 255).astype(np.uint8), GREY, None, "rendered image has type uint8"),
        (GREY, GREY, np.zeros((20, 20), bool), "mask is empty"),
        (GREY, GREY, np.ones((20, 19), bool), "expected bool of shape"),
        (GREY, GREY, np.ones((20, 20), np.uint8), "mask is uint8"),
        (GREY[:10], GREY[:10], None, "at least 11 a side"),
        (GREY, GREY, np.eye(20, k=19, dtype=bool), "no pixel of the mask"),
    ],
)
def test_what_cannot_be_compared_is_named(
    rendered: np.ndarray, photo: np.ndarray, mask: np.ndarray | None, message: str
) -> None:
    with pytest.raises(PocketGSError, match=f"view 3: .*{message}"):
        evaluate([Pair("view 3", rendered, photo, mask)], with_lpips=False)


def test_renderings_are_clipped_as_on_a_screen(photo: np.ndarray) -> None:
    rendered = 1.3 * noisy(photo, 0.1) - 0.1
    clipped = np.clip(rendered, 0.0, 1.0)
    assert (clipped != rendered).any()
    found, expected = (evaluate([Pair("a", image, photo)], with_lpips=False) for image in (rendered, clipped))
    assert found == expected


def test_no_images() -> None:
    with pytest.raises(PocketGSError, match="no images"):
        evaluate([], with_lpips=False)


def test_means_are_over_images() -> None:
    evaluation = Evaluation(
        [
            ImageMetrics("a", 20.0, 0.5, 21.0, 0.5, 0.25),
            ImageMetrics("b", 30.0, 0.75, 33.0, 0.25),
            ImageMetrics("c", 40, 1, 42),
        ]
    )
    assert evaluation.means == {"psnr": 30.0, "cc_psnr": 32.0, "ssim": 0.75, "flip": 0.375, "lpips": 0.25}
    without = Evaluation([ImageMetrics("a", 20.0, 0.5, 20.0)])
    assert (without.flip, without.lpips) == (None, None)


def test_takes_a_generator_and_is_json(photo: np.ndarray) -> None:
    evaluation = evaluate((Pair(str(n), noisy(photo, 0.1, n), photo) for n in range(2)), with_lpips=False)
    assert [image.name for image in evaluation.images] == ["0", "1"]
    assert evaluation.lpips_note is None
    json.dumps(asdict(evaluation), allow_nan=False)


def test_missing_lpips_is_reported(monkeypatch: pytest.MonkeyPatch, photo: np.ndarray) -> None:
    monkeypatch.setitem(sys.modules, "lpips", None)
    evaluation = evaluate([Pair("a", photo, photo)])
    assert evaluation.lpips is None
    assert evaluation.lpips_note is not None
    assert "pip install '.[lpips]'" in evaluation.lpips_note


def test_lpips_compares_what_lies_within_the_mask(photo: np.ndarray) -> None:
    """With a network that measures absolute differences of the images that it is given."""
    pytest.importorskip("torch")
    shapes = []

    def network(first: Any, second: Any, normalize: bool) -> Any:
        assert normalize
        shapes.append(tuple(first.shape))
        return (first - second).abs().mean()

    metric = Lpips(network)
    mask = np.zeros(photo.shape[:2], dtype=bool)
    mask[20:60, 30:90] = True
    spoilt = np.where(mask[..., None], photo, 1.0 - photo)
    assert metric.distance(spoilt, photo, mask) == 0
    assert metric.distance(spoilt, photo, ~mask) == metric.distance(spoilt, photo)
    assert metric.distance(spoilt, photo) == pytest.approx(np.abs(spoilt - photo).mean(), rel=1e-5)
    assert set(shapes) == {(1, 3, *photo.shape[:2])}


def test_failed_download_of_weights_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def unreachable(**_: object) -> None:
        raise OSError("no route to host")

    monkeypatch.setitem(sys.modules, "lpips", SimpleNamespace(LPIPS=unreachable))
    metric, note = Lpips.load()
    assert metric is None
    assert "no route to host" in note
