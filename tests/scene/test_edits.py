"""Edits of a scene: an edited scene renders like the original from the corresponding camera."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.scene.edits import (
    cropped,
    drawable,
    rotated,
    scaled,
    sh_rotation,
    translated,
    with_sh_degree,
    without_faint,
)
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.spherical_harmonics import basis
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.rendering import render
from scene.formats.scenes import covariances, random_scene

ANGLES = st.tuples(*[st.floats(-180, 180)] * 3)


def rotation_of(angles: tuple[float, float, float]) -> np.ndarray:
    return Rotation.from_euler("xyz", angles, degrees=True).as_matrix()


@given(angles=ANGLES, coefficients=st.sampled_from([1, 4, 9, 16]))
@settings(max_examples=30)
def test_turned_harmonics_show_in_a_direction_what_they_showed_in_the_turned_back_one(
    angles: tuple[float, float, float], coefficients: int
) -> None:
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sh, rotation = rng.normal(size=(coefficients, 3)), rotation_of(angles)
    turned = sh_rotation(rotation, coefficients) @ sh
    before = basis(directions @ rotation, coefficients) @ sh
    np.testing.assert_allclose(basis(directions, coefficients) @ turned, before, atol=1e-10)


@given(angles=ANGLES)
@settings(max_examples=30)
def test_turned_covariances(angles: tuple[float, float, float]) -> None:
    scene, rotation = random_scene(20, 3), rotation_of(angles)
    turned = rotated(scene, rotation)
    np.testing.assert_allclose(turned.means, scene.means @ rotation.T, atol=1e-5)
    before = covariances(scene)
    largest = before.max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(covariances(turned) / largest, rotation @ before @ rotation.T / largest, atol=1e-5)
    back = rotated(turned, rotation.T)
    np.testing.assert_allclose(back.sh, scene.sh, atol=1e-5)


def test_what_cannot_be_drawn_is_left_out() -> None:
    scene = random_scene(6, 1)
    scene.means[0, 1], scene.log_scales[1, 2], scene.sh[2, 0, 0] = np.nan, -np.inf, np.inf
    scene.quaternions[3], scene.opacity_logits[4] = 0, np.inf
    kept = drawable(scene)
    np.testing.assert_array_equal(kept.means, scene.means[3:])
    np.testing.assert_array_equal(kept.quaternions, [[1, 0, 0, 0], *scene.quaternions[4:]])
    assert drawable(kept) is kept
    with pytest.raises(PocketGSError, match="no Gaussian without NaN"):
        drawable(scene.select(np.arange(3)))


def test_half_turns_of_the_formats_are_rotations() -> None:
    from pocketgs.scene.formats.axes import LEFT_UP_FORWARD, RIGHT_UP_BACK, half_turn

    scene = random_scene(20, 3)
    for signs in (RIGHT_UP_BACK, LEFT_UP_FORWARD):
        fast, slow = half_turn(scene, signs), rotated(scene, np.diag(np.array(signs, float)))
        np.testing.assert_allclose(fast.means, slow.means, atol=1e-6)
        np.testing.assert_allclose(fast.sh, slow.sh, atol=1e-6)
        np.testing.assert_allclose(covariances(fast), covariances(slow), rtol=1e-3, atol=1e-3)
        assert half_turn(fast, signs).sh.tobytes() == scene.sh.tobytes()


def test_moved_scene_looks_the_same_to_a_moved_camera() -> None:
    """Renderings of view-dependent Gaussians agree if scene and camera are scaled, rotated and moved together."""
    rng = np.random.default_rng(1)
    scene = random_scene(60, 3, extent=1.0)
    scene = Gaussians(
        scene.means, rng.uniform(-3, -1.5, (60, 3)), scene.quaternions, scene.opacity_logits, scene.sh * 0.3
    )
    pose = look_at(np.array([0.0, 0.5, -4.0]), np.zeros(3), np.array([0.0, -1.0, 0.0]))
    rotation, factor, offset = rotation_of((30, -50, 70)), 2.5, np.array([1.0, -2.0, 3.0])
    moved = translated(rotated(scaled(scene, factor), rotation), offset)
    taken_along = np.eye(4)
    taken_along[:3, :3] = pose[:3, :3] @ rotation.T
    taken_along[:3, 3] = factor * pose[:3, 3] - taken_along[:3, :3] @ offset
    options = EngineOptions(engine="cpu")
    pictures = [
        render(each, Camera(64, 48, 60.0, 60.0, 32.0, 24.0, where), engine=options).image
        for each, where in ((scene, pose), (moved, taken_along))
    ]
    assert pictures[0].std() > 0.05
    np.testing.assert_allclose(pictures[0], pictures[1], atol=2e-3)


def test_cropped_keeps_what_lies_inside() -> None:
    scene = random_scene(200, 1)
    low, high = np.array([-1, -2, -3]), np.array([2.0, 1.0, 0.5])
    kept = cropped(scene, low, high)
    expected = [index for index, mean in enumerate(scene.means) if (mean >= low).all() and (mean <= high).all()]
    assert 0 < len(expected) < 200
    assert kept.means.tolist() == scene.means[expected].tolist()
    assert kept.sh.tolist() == scene.sh[expected].tolist()


def test_without_faint() -> None:
    scene = random_scene(100, 0)
    kept = without_faint(scene, 0.5)
    assert len(kept) == np.count_nonzero(scene.opacity_logits >= 0)
    assert (kept.opacity_logits >= 0).all()


def test_with_sh_degree() -> None:
    scene = random_scene(5, 2)
    assert with_sh_degree(scene, 1).sh.tolist() == scene.sh[:, :4].tolist()
    more = with_sh_degree(scene, 3).sh
    assert more[:, :9].tolist() == scene.sh.tolist()
    assert not more[:, 9:].any()


def test_centres_beyond_the_range_of_numbers() -> None:
    scene = random_scene(3, 1)
    scene.means[1] = 3e38
    for edit in (
        lambda: scaled(scene, 2.0),
        lambda: rotated(scene, rotation_of((0, 0, 45))),
        lambda: translated(scene, np.array([2e38, 0, 0])),
    ):
        with pytest.raises(PocketGSError, match=r"moves a centre to [\d.]+e\+38, beyond what scenes can hold"):
            edit()
    scene.means[1] = np.inf, 0, 0
    with np.errstate(invalid="ignore"):
        assert np.isfinite(rotated(scene, rotation_of((0, 0, 45))).means[[0, 2]]).all()


def test_what_cannot_be_done() -> None:
    scene = random_scene(3, 1)
    for edit in (
        lambda: cropped(scene, np.array([0, 0, 1]), np.array([1, 1, 0])),
        lambda: cropped(scene, np.array([0, 0, np.nan]), np.ones(3)),
        lambda: without_faint(scene, 1.5),
        lambda: without_faint(scene, float("nan")),
        lambda: with_sh_degree(scene, 4),
        lambda: scaled(scene, 0.0),
        lambda: scaled(scene, float("inf")),
        lambda: rotated(scene, np.eye(3) * 2),
        lambda: rotated(scene, np.diag([1.0, 1.0, -1.0])),
        lambda: translated(scene, np.array([0, np.inf, 0])),
    ):
        with pytest.raises(PocketGSError, match=r"expected|orthonormal"):
            edit()
