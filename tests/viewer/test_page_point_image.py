"""Points that are drawn without a GPU, by themselves, in a browser that has none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from playwright.sync_api import Page

from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import SH_DC, Gaussians
from pocketgs.splat.near_plane import near_plane
from pocketgs.splat.webgpu.scene_columns import to_columns

BACKGROUND = (0.2, 0.4, 0.6)
MIN_OPACITY = 0.1
MAX_RADIUS = 64.0
CAMERA = Camera(40, 30, 30.0, 30.0, 20.7, 14.2, np.eye(4))

DRAW = """async ([shape, sh, counts, camera, share, background]) => {
    const load = (name) => import(new URL(`page/${name}.js`, document.baseURI));
    const [{ GaussianColumns }, { Points }, { PointImage }] = await Promise.all(
        ["scene/gaussian_columns", "drawing/points", "drawing/point_image"].map(load),
    );
    const scene = new GaussianColumns(shape[0].length, 1);
    scene.shape.set(shape.flat());
    scene.sh.set(sh.flat());
    const points = new Points(scene);
    const image = new PointImage(camera.width, camera.height);
    return counts.map((count) => {
        points.extendTo(count);
        image.draw(points, camera, share, background);
        return Array.from(image.data.data);
    });
}"""


def draw(page: Page, scene: Gaussians, *counts: int, share: float = 1.0) -> list[np.ndarray]:
    """(H, W, 3) uint8: the image of the first n points, for each n, drawn one after the other."""
    shape, sh = to_columns(scene)
    fields = ("width", "height", "fx", "fy", "cx", "cy")
    camera = {name: getattr(CAMERA, name) for name in fields} | {"world_to_camera": np.eye(4).ravel().tolist()}
    found: Any = page.evaluate(DRAW, [shape.tolist(), sh.tolist(), counts, camera, share, BACKGROUND])
    return [np.array(image, np.uint8).reshape(CAMERA.height, CAMERA.width, 4)[..., :3] for image in found]


def nearest_discs(scene: Gaussians, share: float) -> tuple[np.ndarray, np.ndarray]:
    """The image as the definition has it, (H, W, 3) float, and (H, W) where rounding may decide otherwise."""
    rows, columns = np.indices((CAMERA.height, CAMERA.width)) + 0.5
    image = np.tile(np.round(255 * np.array(BACKGROUND)), (CAMERA.height, CAMERA.width, 1))
    depths, unsure = np.full(rows.shape, np.inf), np.zeros(rows.shape, bool)
    opacities = 1 / (1 + np.exp(-scene.opacity_logits.astype(float)))
    near = near_plane(scene.means)
    for mean, log_scale, opacity, dc in zip(
        scene.means.astype(float), scene.log_scales.astype(float), opacities, scene.sh[:, 0].astype(float), strict=True
    ):
        if opacity <= MIN_OPACITY or mean[2] < near:
            continue
        x, y = CAMERA.fx * mean[0] / mean[2] + CAMERA.cx, CAMERA.fy * mean[1] / mean[2] + CAMERA.cy
        reach = np.exp(log_scale.mean()) * np.sqrt(2 * np.log(opacity / MIN_OPACITY))
        radius = min(CAMERA.fy * reach / mean[2], share * MAX_RADIUS)
        half = np.maximum(np.sqrt(np.maximum(radius**2 - (rows - y) ** 2, 0)), 0.5)
        above = max(radius, 0.5) - np.abs(rows - y)
        beside = half - np.abs(columns - x)
        unsure |= (np.minimum(np.abs(above), np.abs(beside)) < 1e-3) | (np.abs(depths - mean[2]) < 1e-5)
        covered = (above >= 0) & (beside >= 0) & (mean[2] < depths)
        depths[covered] = mean[2]
        image[covered] = np.clip(np.round(255 * (0.5 + SH_DC * dc)), 0, 255)
    return image, unsure


@st.composite
def scenes(draw: st.DrawFn) -> Gaussians:
    """Points of all sizes before, beside and behind the camera."""
    count = draw(st.integers(1, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    means = rng.uniform((-3, -2, -1), (3, 2, 5), (count, 3))
    log_scales = rng.normal(draw(st.floats(-6, 0)), 0.5, (count, 3))
    sh = rng.normal(0, 1.5, (count, 1, 3))
    return Gaussians(means, log_scales, np.ones((count, 4)), rng.uniform(-4, 6, count), sh)


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(scene=scenes(), share=st.sampled_from([1.0, 0.25, 0.05]))
def test_image_shows_the_nearest_disc_at_every_pixel(page: Page, scene: Gaussians, share: float) -> None:
    """Of discs that are bounded at a size in pixels of the full resolution."""
    (image,) = draw(page, scene, len(scene), share=share)
    expected, unsure = nearest_discs(scene, share)
    assert unsure.mean() < 0.2
    assert np.abs(image - expected)[~unsure].max(initial=0) <= 1


def test_image_grows_with_what_arrives(page: Page) -> None:
    scene = Gaussians(
        [[-1.0, 0.0, 2.0], [1.0, 0.0, 2.0]],
        np.full((2, 3), np.log(0.2)),
        np.ones((2, 4)),
        [5.0, 5.0],
        np.full((2, 1, 3), 0.5 / SH_DC),
    )
    nothing, left, both = draw(page, scene, 0, 1, 2)
    white = [(image == 255).all(axis=2) for image in (nothing, left, both)]
    assert not white[0].any()
    assert white[1][:, :20].any()
    assert not white[1][:, 20:].any()
    assert (white[2][:, :20] == white[1][:, :20]).all()
    assert white[2][:, 20:].any()


@pytest.mark.parametrize(
    ("name", "value"),
    [(name, value) for name in ("means", "log_scales", "opacity_logits") for value in (np.nan, -np.inf)]
    + [("means", np.inf)],
)
def test_points_that_are_no_numbers_are_left_out(page: Page, name: str, value: float) -> None:
    """An invisible point in front of a visible one."""
    fields = {
        "means": np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]]),
        "log_scales": np.full((2, 3), np.log(0.1)),
        "quaternions": np.ones((2, 4)),
        "opacity_logits": np.full(2, 5.0),
        "sh": np.full((2, 1, 3), (0.3, -0.2, 0.1)),
    }
    (alone,) = draw(page, Gaussians(**{field: values[1:] for field, values in fields.items()}), 1)
    fields[name][0] = value
    (image,) = draw(page, Gaussians(**fields), 2)
    np.testing.assert_array_equal(image, alone)
