"""The page computes the same numbers before and beside the passes as Python."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import cv2
import numpy as np
import pytest

from pocketgs.capture import Capture
from pocketgs.capture.frame_edits import size_after
from pocketgs.capture.frame_parts import composite
from pocketgs.capture.synthetic import true_capture
from pocketgs.capture.undistortion import undistortion
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import Lens
from pocketgs.prior.cloud.visual_hull import outside_hull
from pocketgs.prior.cloud.volume import draw_points
from pocketgs.scene.morton import morton_order
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.seeding.seeds import seed_discs
from pocketgs.site.settings import RECIPE
from pocketgs.splat.settings import StepSettings
from pocketgs.splat.webgpu.frame_values import update_values
from pocketgs.splat.webgpu.photographs import Shelf
from pocketgs.splat.webgpu.scene_columns import from_columns
from pocketgs.training import recipes
from pocketgs.training.dropout import dropout_of_step, dropout_share, views_per_point
from pocketgs.training.recipes import RECIPES, pixel_footprint
from pocketgs.training.view_choice import view_of_step
from static_site.given import OPEN_DEVICE, TYPED, plain, plain_cloud, plain_frames

Call = Callable[..., Any]


@pytest.fixture(scope="module")
def capture() -> Capture:
    return true_capture(width=64, height=48, frames=6, points=500)


@pytest.mark.parametrize(("seed", "views"), [(0, 1), (0, 17), (3, 40), (12345, 300)])
def test_views_come_in_the_same_order(call: Call, seed: int, views: int) -> None:
    script = """
        const order = new module.ViewOrder(given.views, given.seed);
        return given.steps.map((step) => order.at(step));
    """
    steps = [0, 1, views - 1, views, 2 * views + 1, 5 * views, 7 * views + views // 2]
    found = call("training/view_order.js", script, {"views": views, "seed": seed, "steps": steps})
    assert found == [view_of_step(step, views, seed) for step in steps]


def test_random_numbers_are_numpys(call: Call) -> None:
    script = """
        const random = new module.Generator(...given.seeds);
        return given.ends.flatMap((end) => [random.integer(end), random.uniform(-0.5, 2)]);
    """
    ends = [1, 2, 7, 1000, 2**31, 2**32 - 1, 12]
    found = call("random/generator.js", script, {"seeds": [7, 4], "ends": ends})
    random = np.random.default_rng((7, 4))
    assert found == [number for end in ends for number in (int(random.integers(end)), random.uniform(-0.5, 2))]


def test_seeds_are_the_same_discs(call: Call) -> None:
    random = np.random.default_rng(1)
    positions = random.normal(0, [3.0, 1.0, 0.05], (700, 3))
    positions[100:400] = positions[600:].repeat(3, axis=0)  # three hundred coincide with one of the last hundred
    points = PointCloud(positions, random.uniform(0, 1, (700, 3)))
    recipe = RECIPES[RECIPE]
    script = (
        TYPED
        + OPEN_DEVICE
        + """
        const { distinctNeighbourhoods } = await import(new URL("seeding/distinct.js", location.href));
        const { NeighbourSearch } = await import(new URL("seeding/neighbour_search.js", location.href));
        const passes = await (await fetch("seeding_passes.json")).json();
        const search = await NeighbourSearch.open(device, passes, settings.seeding);
        const cloud = cloudOf(given);
        const around = await distinctNeighbourhoods(search, cloud.positions, settings.run.min_points);
        const scene = module.seedDiscs(cloud, around, settings.recipe, settings.seeding);
        device.destroy();
        return [[...scene.shape], [...scene.sh], complaints];
    """
    )
    *scene, complaints = call("seeding/discs.js", script, plain_cloud(points))
    assert complaints == []
    shape, sh = (np.float32(values).reshape(-1, 700) for values in scene)
    found, expected = from_columns(shape, sh), seed_discs(points, recipe.opacity, recipe.sh_degree, recipe.seed_size)
    for name in ("means", "log_scales", "opacity_logits", "sh"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=0, atol=1e-5)
    alike = np.abs(np.sum(normals(found.quaternions) * normals(expected.quaternions), axis=1))
    assert np.quantile(alike, 0.01) > 1 - 1e-6


def test_distinct_points_are_counted(call: Call) -> None:
    script = """
        const search = { around: async (found) => ({ spacing: found, normals: found, tangents: found }) };
        const positions = Float64Array.from([...given, ...given]);
        await module.distinctNeighbourhoods(search, positions, given.length / 3);
        return module.distinctNeighbourhoods(search, positions, given.length / 3 + 1).catch(({ message }) => message);
    """
    found = call("seeding/distinct.js", script, np.random.default_rng(0).normal(size=9).tolist())
    assert found == "6 points to start from, 3 of them distinct: at least 4 are needed."


def normals(quaternions: np.ndarray) -> np.ndarray:
    w, x, y, z = quaternions.T.astype(np.float64)
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)


def test_morton_order(call: Call) -> None:
    random = np.random.default_rng(2)
    means = random.normal(0, 1, (3000, 3)).astype(np.float32)
    means[::50] *= 100
    means[10:20] = means[9]
    script = "return [...module.mortonOrder(Float64Array.from(given), settings.seeding.morton_bits)];"
    np.testing.assert_array_equal(
        call("seeding/morton.js", script, means.reshape(-1).tolist()), morton_order(means.astype(np.float64))
    )


@pytest.mark.parametrize("masked", [False, True])
def test_points_are_drawn_where_photographs_agree(call: Call, capture: Capture, masked: bool) -> None:
    if masked:
        mask = np.arange(64) > 20
        frames = [replace(frame, mask=np.broadcast_to(mask, (48, 64))) for frame in capture.train]
        capture = replace(capture, train=frames)
    script = """
        const frames = given.map((frame) => ({...frame, rgba: Uint8ClampedArray.from(frame.rgba)}));
        const {positions, colours} = module.drawPoints(frames, 300, 5, settings.volume);
        return [[...positions], [...colours]];
    """
    positions, colours = (
        np.reshape(x, (-1, 3)) for x in call("seeding/volume.js", script, plain_frames(capture.train))
    )
    expected = draw_points(capture.train, 300, 5)
    # float32 in Python and doubles here: single choices between equal depths may differ.
    same = np.linalg.norm(positions - expected.positions, axis=1) < 1e-4
    assert len(positions) == len(expected) == 300
    assert np.mean(same) > 0.9
    np.testing.assert_allclose(colours[same], expected.colours[same], atol=1e-6)


@pytest.mark.parametrize("lost", [False, True])
def test_the_visual_hull(call: Call, capture: Capture, lost: bool) -> None:
    """Frames without alpha have no say, and neither has one whose object was cut away too."""
    rows, columns = np.mgrid[0:48, 0:64]
    disc = np.where(np.hypot(rows - 24, columns - 32) < 18, 255, 0).astype(np.uint8)
    frames = [capture.train[0], *(replace(frame, alpha=disc) for frame in capture.train[1:])]
    if lost:
        frames.append(replace(frames[1], alpha=np.where(columns < 3, disc, 0).astype(np.uint8)))
    assert capture.points is not None
    points = np.repeat(capture.points.positions.astype(np.float64), 3, axis=0)
    points += np.random.default_rng(0).normal(0.0, 0.3, points.shape)
    script = """
        const frames = given.frames.map((frame) => ({...frame, rgba: Uint8ClampedArray.from(frame.rgba)}));
        return [...module.outsideHull(Float64Array.from(given.points), frames, settings.volume.judging_points)];
    """
    found = call("seeding/visual_hull.js", script, {"points": points.ravel().tolist(), "frames": plain_frames(frames)})
    expected = outside_hull(points, frames)
    np.testing.assert_array_equal(found, expected)
    assert 0.1 < expected.mean() < 0.9


@pytest.mark.parametrize("iterations", [40, 500, 2500])
def test_rates(call: Call, capture: Capture, iterations: int) -> None:
    recipe = RECIPES[RECIPE]
    assert capture.points is not None
    cameras = [frame.camera for frame in capture.train]
    unit = pixel_footprint(cameras, capture.points)
    script = """
        const unit = module.pixelFootprint(given.cameras, Float64Array.from(given.positions), 1e6);
        const initial = module.initialRates(settings.recipe, given.iterations, unit);
        return given.shares.map((share) => module.ratesAt(initial, settings.recipe.schedule, share));
    """
    shares = [0.0, 0.1234, 0.5, 0.97, 1.0]
    given = {
        "cameras": [plain(camera) for camera in cameras],
        "positions": capture.points.positions.reshape(-1).tolist(),
        "iterations": iterations,
        "shares": shares,
    }
    initial = recipe.rates_for(iterations, unit)
    for share, found in zip(shares, call("training/rates.js", script, given), strict=True):
        assert found == pytest.approx(asdict(recipe.schedule(initial, share)), rel=1e-3)


@pytest.mark.parametrize("most", [150, 1000, recipes.MOST_DEPTHS])
def test_the_footprint_of_a_pixel_in_bounded_memory(
    call: Call, capture: Capture, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recipes, "MOST_DEPTHS", most)
    assert capture.points is not None
    cameras = [frame.camera for frame in capture.train]
    script = """
        const positions = Float64Array.from(given.positions);
        return [module.pixelFootprint(given.cameras, positions, given.most), settings.recipe.most_depths];
    """
    given = {
        "cameras": [plain(camera) for camera in cameras],
        "positions": capture.points.positions.reshape(-1).tolist(),
        "most": most,
    }
    footprint, stated = call("training/rates.js", script, given)
    assert footprint == pytest.approx(pixel_footprint(cameras, capture.points), rel=1e-9)
    assert stated == 10_000_000


def test_dropout(call: Call, capture: Capture) -> None:
    assert capture.points is not None
    cameras = [frame.camera for frame in capture.train]
    most = RECIPES[RECIPE].dropout
    script = """
        const { dropout } = settings.recipe;
        const found = module.viewsPerPoint(given.cameras, Float64Array.from(given.positions), dropout.most_points);
        const shares = given.views.map((views) => module.dropoutShare(dropout, views));
        const steps = given.steps.map((step) => module.dropoutOfStep(...step));
        return [found, shares, steps.map((one) => [one.dropout_threshold, one.dropout_seed])];
    """
    views, steps = [0, 3, 8, 9.5, 12, 40], [(0.1, 1, 0), (0.05, 500, 7), (0.1, 12, 2**40 + 1)]
    given = {
        "cameras": [plain(camera) for camera in cameras],
        "positions": capture.points.positions.reshape(-1).tolist(),
        "views": views,
        "steps": steps,
    }
    found, shares, uniforms = call("training/dropout.js", script, given)
    assert found == views_per_point(cameras, capture.points)
    assert shares == pytest.approx([dropout_share(most, one) for one in views])
    expected = [dropout_of_step(*step) for step in steps]
    assert uniforms == [[one.threshold, one.seed] for one in expected if one]
    [_, nothing] = call("training/dropout.js", "return [0, module.dropoutOfStep(0, 1, 0)];", None)
    assert nothing == {"dropout_threshold": 0, "dropout_seed": 1}


@pytest.mark.parametrize(("width", "height"), [(126, 94), (9, 40)])
def test_values_of_an_update(call: Call, width: int, height: int) -> None:
    recipe = RECIPES[RECIPE]
    camera = Camera(width, height, 100.0, 100.0, 50.0, 50.0, np.eye(4))
    symbols = {"gaussians": 1000, "coefficients": 9, "photographs": 7}
    rates = recipe.rates_for(500, 0.01)
    script = """
        const {rates, camera, symbols} = given;
        return module.updateValues(settings.recipe, rates, camera, symbols, 4100, 3, settings.engine);
    """
    given = {"rates": asdict(rates), "camera": plain(camera), "symbols": symbols}
    expected = update_values(StepSettings(rates, recipe.loss, recipe.adam), camera, symbols, 4100, 3)
    assert call("training/update_values.js", script, given) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("room", [60, 100, 35, 30])
def test_places_of_photographs(call: Call, room: int) -> None:
    sizes = [10, 30, 20, 5, 30]
    script = """
        const shelf = new module.Shelf(given.sizes, given.room);
        return [shelf.pixels, given.sizes.map((_, i) => [shelf.place(i), shelf.isResident(i)])];
    """
    shelf = Shelf(sizes, room)
    expected = [shelf.pixels, [[shelf.place(i), shelf.is_resident(i)] for i in range(len(sizes))]]
    assert call("training/shelf.js", script, {"sizes": sizes, "room": room}) == expected


@pytest.mark.parametrize(
    "lens",
    [Lens("opencv", (-0.25, 0.09, 0.001, -0.002, 0.01, 0.0, 0.0, 0.0)), Lens("fisheye", (0.03, -0.01, 0.004, -0.001))],
    ids=["opencv", "fisheye"],
)
def test_undistorted_images(call: Call, lens: Lens) -> None:
    camera = Camera(97, 71, 80.0, 82.0, 47.0, 36.5, np.eye(4))
    image = cv2.GaussianBlur(np.random.default_rng(3).integers(0, 256, (71, 97, 3)).astype(np.uint8), (7, 7), 2)
    undoing = undistortion(camera, lens)
    script = """
        const {camera, lens, image} = given;
        const view = module.undistortedView(camera, lens, settings.capture);
        const pixels = {width: camera.width, height: camera.height, rgba: Uint8ClampedArray.from(image)};
        return [view, [...module.resampled(pixels, lens, view.camera, view.left, view.top).rgba]];
    """
    given = {
        "camera": plain(camera),
        "lens": {"model": lens.model, "coefficients": lens.coefficients},
        "image": np.dstack([image, np.full((71, 97), 255, np.uint8)]).reshape(-1).tolist(),
    }
    view, rgba = call("capture/undistortion.js", script, given)
    assert (view["left"], view["top"]) == (undoing.left, undoing.top)
    numbers = ("width", "height", "fx", "fy", "cx", "cy")
    assert [view["camera"][name] for name in numbers] == pytest.approx(
        [getattr(undoing.view(camera), n) for n in numbers]
    )
    found = np.reshape(rgba, (undoing.height, undoing.width, 4))[..., :3]
    assert np.abs(found - undoing.apply(image, cv2.INTER_LINEAR).astype(int)).max() <= 2  # OpenCV: 1/32 pixel


@pytest.mark.parametrize("most", [96, 50, 32, 7])
def test_smaller_images(call: Call, most: int) -> None:
    image = np.random.default_rng(4).integers(0, 256, (66, 97, 4)).astype(np.uint8)
    script = """
        const before = {width: 97, height: 66};
        const after = module.sizeWithin(before, given.most);
        const rgba = Uint8ClampedArray.from(given.image);
        return [after.width, after.height, [...module.averagedPlane(rgba, 4, before, after)]];
    """
    width, height, rgba = call("capture/pixels.js", script, {"most": most, "image": image.reshape(-1).tolist()})
    assert (width, height) == size_after(97, 66, 1.0, most)
    expected = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA).astype(int)
    assert np.abs(np.reshape(rgba, expected.shape) - expected).max() <= 1


def test_transparent_images_on_a_background(call: Call) -> None:
    image = np.random.default_rng(5).integers(0, 256, (20, 30, 4)).astype(np.uint8)
    script = """
        const rgba = Uint8ClampedArray.from(given);
        module.composite({width: 30, height: 20, rgba}, [1, 0.5, 0]);
        return [...rgba];
    """
    found = np.reshape(call("capture/pixels.js", script, image.reshape(-1).tolist()), (20, 30, 4))
    expected = composite(image[..., :3], image[..., 3], (1.0, 0.5, 0.0))
    off = np.abs(found[..., :3] - expected.astype(int))  # by one where a half is one of doubles, but not of float32
    assert off.max() <= 1
    assert off.mean() < 0.01
