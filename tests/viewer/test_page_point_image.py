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
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.webgpu.scene_columns import to_columns
from viewer.marks import psnr

BACKGROUND = (0.2, 0.4, 0.6)
CAMERA = Camera(40, 30, 30.0, 30.0, 20.7, 14.2, np.eye(4))

DRAW = """async ([shape, sh, counts, camera, background]) => {
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
        Array.from(image.draw(points, camera, background));
        return Array.from(image.data.data);
    });
}"""


@pytest.fixture(scope="module")
def engine() -> CpuEngine:
    return CpuEngine()


def draw(page: Page, scene: Gaussians, *counts: int) -> list[np.ndarray]:
    """(H, W, 3) uint8: the image of the first n points, for each n, drawn one after the other."""
    shape, sh = to_columns(scene)
    fields = ("width", "height", "fx", "fy", "cx", "cy")
    camera = {name: getattr(CAMERA, name) for name in fields} | {"world_to_camera": np.eye(4).ravel().tolist()}
    found: Any = page.evaluate(DRAW, [shape.tolist(), sh.tolist(), counts, camera, BACKGROUND])
    return [np.array(image, np.uint8).reshape(CAMERA.height, CAMERA.width, 4)[..., :3] for image in found]


@st.composite
def scenes(draw: st.DrawFn) -> Gaussians:
    """Gaussians of all shapes before, beside and behind the camera; none is so large that it would be shortened."""
    count = draw(st.integers(1, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    means = rng.uniform((-3, -2, -1), (3, 2, 5), (count, 3))
    means[np.abs(means[:, 2]) < 1, 2] = 1.5
    log_scales = np.minimum(rng.normal(draw(st.floats(-6, -2.5)), 0.5, (count, 3)), -2.3)
    sh = rng.normal(0, 0.8, (count, 1, 3))
    return Gaussians(means, log_scales, rng.normal(size=(count, 4)), rng.uniform(-4, 6, count), sh)


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(scene=scenes())
def test_image_is_the_engines(page: Page, engine: CpuEngine, scene: Gaussians) -> None:
    """Of view-independent colours in [0, 1]."""
    scene.sh[...] = np.clip(scene.sh, -0.5 / SH_DC, 0.5 / SH_DC)
    (image,) = draw(page, scene, len(scene))
    engine.upload(scene)
    assert psnr(image / 255, np.clip(engine.render(CAMERA, BACKGROUND).image, 0, 1)) > 38


def test_a_far_giant_is_bounded_and_hidden_by_what_is_before_it(page: Page) -> None:
    """It would cover the image; it ends at a quarter of the image's width, softly."""
    white, black = np.full(3, 0.5 / SH_DC), np.full(3, -0.5 / SH_DC)
    giant = Gaussians([[0.0, 0.0, 200.0]], np.full((1, 3), np.log(500.0)), np.ones((1, 4)), [5.0], white[None, None])
    (image,) = draw(page, giant, 1)
    rows, columns = np.indices(image.shape[:2]) + 0.5
    radius = np.hypot(columns - CAMERA.cx, rows - CAMERA.cy)
    inside = 255 - image[radius < 1]
    assert inside.max() < 20
    assert (image[radius > 10.1] == np.round(255 * np.array(BACKGROUND))).all()
    halfway = image[(radius > 4) & (radius < 7)]
    assert (halfway[:, 0] > 255 * BACKGROUND[0] + 10).all()
    assert halfway.max() < 250
    # It comes first in the file, and is drawn last.
    both = Gaussians(
        [[0.0, 0.0, 200.0], [0.0, 0.0, 2.0]],
        np.log([[500.0] * 3, [0.1] * 3]),
        np.ones((2, 4)),
        [5.0, 6.0],
        np.stack([white, black])[:, None],
    )
    (image,) = draw(page, both, 2)
    assert image[radius < 1].max() < 40
    assert image[(radius > 4) & (radius < 6)].mean() > 100


def test_a_needle_is_shortened_along_its_length_only(page: Page) -> None:
    log_scales = np.log([[9.0, 0.05, 0.05]])
    needle = Gaussians([[0.0, 0.0, 2.0]], log_scales, [[1.0, 0.0, 0.0, 0.0]], [5.0], np.ones((1, 1, 3)))
    (image,) = draw(page, needle, 1)
    rows, columns = np.nonzero(np.abs(image - np.round(255 * np.array(BACKGROUND))).max(axis=2) > 1)
    assert 15 <= np.ptp(columns) <= 20
    assert 3 <= np.ptp(rows) <= 8


def test_image_grows_with_what_arrives(page: Page) -> None:
    scene = Gaussians(
        [[-1.0, 0.0, 2.0], [1.0, 0.0, 2.0]],
        np.full((2, 3), np.log(0.1)),
        np.ones((2, 4)),
        [5.0, 5.0],
        np.full((2, 1, 3), 0.5 / SH_DC),
    )
    nothing, left, both = draw(page, scene, 0, 1, 2)
    changed = [(image != nothing).any(axis=2) for image in (left, both)]
    assert len(np.unique(nothing.reshape(-1, 3), axis=0)) == 1
    assert changed[0][:, :20].any()
    assert not changed[0][:, 20:].any()
    assert (changed[1][:, :20] == changed[0][:, :20]).all()
    assert changed[1][:, 20:].any()


@pytest.mark.parametrize(
    ("name", "value"),
    [(name, np.nan) for name in ("means", "log_scales", "opacity_logits")]
    + [("means", np.inf), ("means", -np.inf), ("opacity_logits", -np.inf)],
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
