"""Neighbourhoods on the GPU are those of the CPU: the same neighbours, spacings, normals and tangents."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pocketgs import Gaussians, PointCloud
from pocketgs.capture import open_capture
from pocketgs.scene.gaussians import SH_COEFFICIENTS
from pocketgs.scene.morton import morton_order
from pocketgs.seeding.cpu import CpuSearch
from pocketgs.seeding.devices import create_search, with_room
from pocketgs.seeding.seeds import SEEDINGS
from pocketgs.seeding.webgpu.layout import BOX_BYTES, MOST_NEIGHBOURS, POINT_BYTES, numbers_of
from pocketgs.seeding.webgpu.search import WebGpuSearch
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.webgpu.engine import WebGpuEngine
from seeding.test_seeds import normals

pytestmark = pytest.mark.usefixtures("adapter")


@pytest.fixture(scope="module")
def search() -> WebGpuSearch:
    return WebGpuSearch()


def on_a_wave(count: int) -> np.ndarray:
    """Points of a curved surface with a spacing that varies a little."""
    x, y = np.random.default_rng(count).uniform(-1, 1, (2, count))
    return np.stack([x, y, 0.2 * np.sin(4 * x) * np.cos(3 * y)], axis=1)


def with_a_far_shell(count: int) -> np.ndarray:
    """A surface, and around it a tenth as many points 100 times as far away."""
    outwards = np.random.default_rng(count).normal(size=(count // 10, 3))
    return np.concatenate([on_a_wave(count), 100 * outwards / np.linalg.norm(outwards, axis=1, keepdims=True)])


def ever_denser(count: int) -> np.ndarray:
    """Points whose spacing shrinks to a ten thousandth towards the origin."""
    random = np.random.default_rng(count)
    outwards = random.normal(size=(count, 3))
    return outwards / np.linalg.norm(outwards, axis=1, keepdims=True) * 10.0 ** random.uniform(-4, 0, (count, 1))


CLOUDS = {
    "volume": np.random.default_rng(0).uniform(size=(3000, 3)),
    "surface": on_a_wave(3000),
    "shell": with_a_far_shell(3000),
    "denser": ever_denser(3000),
    "far away": on_a_wave(1000) + np.array([4e5, 5e6, -300]),
    "tiny": 1e-20 * on_a_wave(1000),
    "huge": 1e15 * on_a_wave(1000),
}


def assert_same(search: WebGpuSearch, positions: np.ndarray) -> None:
    """Compare with the CPU. Neighbours on one line, or equally far in all directions, have arbitrary axes."""
    found, expected = search.around(positions), CpuSearch().around(positions)
    np.testing.assert_allclose(found.spacing, expected.spacing, rtol=1e-4)
    for ours, theirs in ((found.normals, expected.normals), (found.tangents, expected.tangents)):
        cosines = np.abs(np.sum(ours * theirs, axis=1))
        assert np.quantile(cosines, 0.001) > 1 - 1e-4
    np.testing.assert_allclose(np.sum(found.normals * found.tangents, axis=1), 0, atol=1e-5)


@pytest.mark.parametrize("name", CLOUDS)
def test_same_neighbourhoods(search: WebGpuSearch, name: str) -> None:
    assert_same(search, CLOUDS[name])


@pytest.mark.parametrize("name", ["volume", "shell", "denser"])
def test_same_neighbours(search: WebGpuSearch, name: str) -> None:
    positions = CLOUDS[name][morton_order(CLOUDS[name])]
    search.submit(positions)
    count = len(positions)
    found = search.executor.read("neighbours", np.uint32, MOST_NEIGHBOURS * count).reshape(count, -1)
    distances, expected = cKDTree(positions).query(positions, k=MOST_NEIGHBOURS)
    # Single precision can swap neighbours that are equally far but for rounding.
    theirs = np.linalg.norm(positions[found] - positions[:, None], axis=2)
    np.testing.assert_allclose(theirs, distances, rtol=1e-4, atol=1e-12)
    assert np.mean(np.sort(found, axis=1) == np.sort(expected, axis=1)) > 0.999


@pytest.mark.parametrize("count", [4, 7, 8, 9, 16, 17, 18, 257])
def test_few_points(search: WebGpuSearch, count: int) -> None:
    assert_same(search, on_a_wave(count))


def test_points_without_a_plane(search: WebGpuSearch) -> None:
    """All in one place, and on a line: spacings are the CPU's, the axes any that fit."""
    for positions in (np.full((300, 3), 7.0), np.arange(300)[:, None] * np.array([2.0, -1.0, 2.0]) / 3):
        found, expected = search.around(positions), CpuSearch().around(positions)
        np.testing.assert_allclose(found.spacing, expected.spacing, rtol=1e-5)
        np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1, atol=1e-5)
        np.testing.assert_allclose(np.sum(found.normals * found.tangents, axis=1), 0, atol=1e-5)
    np.testing.assert_allclose(np.abs(found.tangents @ [2 / 3, -1 / 3, 2 / 3]), 1, atol=1e-5)


def test_points_on_a_plane_and_a_grid(search: WebGpuSearch) -> None:
    grid = np.stack(np.meshgrid(np.arange(40), np.arange(40), [3]), axis=-1).reshape(-1, 3).astype(float)
    found = search.around(grid)
    np.testing.assert_allclose(found.spacing, CpuSearch().around(grid).spacing, rtol=1e-6)
    np.testing.assert_allclose(np.abs(found.normals[:, 2]), 1, atol=1e-6)


def test_points_of_a_real_capture(search: WebGpuSearch, data_folder: Path) -> None:
    points = open_capture(data_folder / "fern", images="images_8", downscale=2).points
    assert points is not None
    assert_same(search, points.positions)


@pytest.mark.parametrize("shape", SEEDINGS)
def test_same_seeds(search: WebGpuSearch, shape: str) -> None:
    positions = np.repeat(on_a_wave(500), [5, *[1] * 499], axis=0)  # five coincide
    random = np.random.default_rng(2)
    points = PointCloud(positions, random.uniform(size=positions.shape), random.normal(size=positions.shape))
    found, expected = (SEEDINGS[shape](points, 0.1, 0, 1.0, one) for one in (search, CpuSearch()))
    np.testing.assert_allclose(found.log_scales, expected.log_scales, atol=1e-4)
    ours, theirs = (covariances(scene) for scene in (found, expected))
    errors = np.abs(ours - theirs).max(axis=(1, 2)) / np.abs(theirs).max(axis=(1, 2))
    assert np.mean(errors < 1e-3) > 0.98
    facing = np.sum(normals(found) * points.directions, axis=1)
    assert shape == "balls" or np.all(facing >= -1e-6)


def covariances(scene: Gaussians) -> np.ndarray:
    """(N, 3, 3), which stay the same where axes are reversed."""
    axes = Rotation.from_quat(scene.quaternions[:, [1, 2, 3, 0]]).as_matrix() * scene.scales[:, None]
    return axes @ axes.transpose(0, 2, 1)


def test_memory_is_given_back(search: WebGpuSearch) -> None:
    search.around(CLOUDS["volume"])
    assert set(search.executor.sizes()) == {"cloud"}


def test_the_cpu_goes_on_where_there_is_too_little_memory(search: WebGpuSearch) -> None:
    assert with_room(search, search.most_points) == (search, ())
    instead, (warning,) = with_room(create_search("webgpu", max_memory=1), 10_000)
    assert instead.name == "cpu"
    assert warning.startswith("neighbours are found on the CPU: 10,000 points, of which the GPU's memory holds 8,")


@pytest.mark.parametrize("count", [4, 8, 9, 1000, 32_769])
def test_memory_is_no_more_than_planned(search: WebGpuSearch, count: int) -> None:
    """And less than the engine takes afterwards, so that plans need not count it."""
    description = search.executor.description
    total = sum(description.sizes(numbers_of(count), description.buffers).values())
    assert total <= POINT_BYTES * count + 2 * BOX_BYTES
    engine = WebGpuEngine(EngineOptions("webgpu")).memory_needed(count, SH_COEFFICIENTS[0], [(64, 48)])
    assert total < engine.device
