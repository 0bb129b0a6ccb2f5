"""Points stand in for splats: while a scene is arriving, and until the GPU has drawn it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, expect

from pocketgs.scene.formats import ply, spz
from pocketgs.scene.gaussians import SH_DC, Gaussians
from pocketgs.viewer.content import Content, View
from pocketgs.viewer.live import SPZ_VERSION, LiveRun
from pocketgs.viewer.server import serving
from viewer.browsing import NO_GPU, PATIENCE, Visit, visiting
from viewer.marks import HEIGHT, MARKS, UP, WIDTH, cameras_around, marked_scene, marks, psnr

BACKGROUND = (0.1, 0.2, 0.3)

HOLD = """
const held = (name) => new Promise((resolve) => (window[`release_${name}`] = resolve));
const [device, rest] = [held("gpu"), held("rest")];
const requestDevice = globalThis.GPUAdapter?.prototype.requestDevice;
if (requestDevice) {
    GPUAdapter.prototype.requestDevice = async function (...options) {
        await device;
        return requestDevice.apply(this, options);
    };
}
const fetchAtOnce = window.fetch;
window.fetch = async (url, ...options) => {
    const response = await fetchAtOnce(url, ...options);
    if (!`${url}`.startsWith("scene")) {
        return response;
    }
    const content = new Uint8Array(await response.arrayBuffer());
    const half = Math.floor(content.length / 2);
    const body = new ReadableStream({
        async start(controller) {
            controller.enqueue(content.subarray(0, half));
            await rest;
            controller.enqueue(content.subarray(half));
            controller.close();
        },
    });
    return new Response(body);
};
"""
"""Holds back the GPU until `release_gpu()`, and the second half of the scene until `release_rest()`."""

CUT = """
const fetchWhole = window.fetch;
window.fetch = async (url, ...options) => {
    const response = await fetchWhole(url, ...options);
    return `${url}`.startsWith("scene") ? new Response((await response.blob()).slice(0, -1)) : response;
};
"""
"""Takes the scene's last byte away."""


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> Content:
    path = tmp_path_factory.mktemp("shown") / "scene.ply"
    ply.write_gaussians(path, marked_scene())
    views = tuple(View(f"{i}.jpg", camera, i == 1) for i, camera in enumerate(cameras_around()))
    return Content("marks", path, False, BACKGROUND, views, UP, (0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def url(content: Content) -> Iterator[str]:
    with serving(content) as page:
        yield page.url


def painted_wall() -> Gaussians:
    """Discs of various opacities on a wavy wall, with stripes; its left half comes first in the file."""
    rng, count = np.random.default_rng(5), 20_000
    across, down = rng.uniform((-2.0, -1.5), (2.0, 1.5), (count, 2)).T
    across = across[np.argsort(across > 0, kind="stable")]
    colours = 0.5 + 0.4 * np.sin(np.stack([6 * across, 5 * down, 4 * (across + down)], axis=1))
    log_scales = np.log((0.03, 0.03, 0.005)) + rng.normal(0.0, 0.3, (count, 3))
    return Gaussians(
        np.stack([across, down, 0.1 * np.sin(9 * across)], axis=1),
        log_scales,
        np.tile((1.0, 0.0, 0.0, 0.0), (count, 1)) + rng.normal(0.0, 0.1, (count, 4)),
        rng.uniform(-2.5, 3.0, count),
        ((colours - 0.5) / SH_DC)[:, None],
    )


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Content:
    path = tmp_path_factory.mktemp("wall") / "scene.ply"
    ply.write_gaussians(path, painted_wall())
    return Content("wall", path, False, BACKGROUND, (View("0.jpg", cameras_around()[0], True),), UP, (0.0, 0.0, 0.0))


def until_points(visit: Visit) -> None:
    expect(visit["#points"]).to_be_visible(timeout=PATIENCE)


def still(visit: Visit) -> np.ndarray:
    """The page's image once it has stopped changing."""
    before = visit.seen()
    for _ in range(60):
        visit.page.wait_for_timeout(500)
        after = visit.seen()
        if np.array_equal(before, after):
            return after
        before = after
    raise AssertionError("the picture never rests")


def covered(picture: np.ndarray) -> np.ndarray:
    """(H, W): where something is in front of the background."""
    return np.abs(picture - BACKGROUND).max(axis=2) > 0.05


def release(visit: Visit, name: str) -> None:
    visit.page.evaluate(f"release_{name}()")


def test_points_stand_in_for_the_gpu(browser: Browser, wall: Content) -> None:
    """Points are shown before the GPU draws, resemble its image, and are then removed."""
    with serving(wall) as page, visiting(browser, page.url, WIDTH, HEIGHT, script=HOLD) as visit:
        release(visit, "rest")
        until_points(visit)
        expect(visit["#loading"]).to_be_hidden()
        expect(visit["#for-now"]).to_be_visible()
        expect(visit["#canvas"]).to_have_attribute("aria-busy", "true")
        expect(visit["#stats"]).to_be_empty()
        points = still(visit)
        release(visit, "gpu")
        visit.until_drawn()
        expect(visit["#points"]).to_be_hidden()
        expect(visit["#for-now"]).to_be_hidden()
        splats = visit.picture()
        assert psnr(visit.seen(), splats) > 40
        assert psnr(points, splats) > 18
        names = "performance.getEntriesByType('mark').map(({ name }) => name)"
        assert visit.page.evaluate(names) == ["first picture", "first sharp picture"]
        assert visit.complaints == []


def test_points_follow_the_camera_and_the_gpu_goes_on_from_there(browser: Browser, url: str) -> None:
    with visiting(browser, url, WIDTH, HEIGHT, script=HOLD) as visit:
        release(visit, "rest")
        until_points(visit)
        before = marks(still(visit))
        visit.drag(30, 20)
        after = marks(still(visit))
        assert after["red"][0] > before["red"][0] + 5
        assert after["red"][1] > before["red"][1] + 2
        release(visit, "gpu")
        there = marks(visit.picture())
        for name, place in after.items():
            np.testing.assert_allclose(place, there[name], atol=1.5, err_msg=name)
        assert visit.complaints == []


def test_what_has_arrived_is_seen(browser: Browser, wall: Content) -> None:
    """Half of the scene while half of the file is there, although the GPU is; then all of it."""
    with serving(wall) as page, visiting(browser, page.url, WIDTH, HEIGHT, script=HOLD) as visit:
        release(visit, "gpu")
        until_points(visit)
        expect(visit["#loading"]).to_be_visible()
        half = still(visit)
        release(visit, "rest")
        splats = visit.picture()
        expect(visit["#loading"]).to_be_hidden()
        left, right = np.s_[:, : WIDTH // 2 - 20], np.s_[:, WIDTH // 2 + 20 :]
        assert psnr(half[left], splats[left]) > 18
        np.testing.assert_allclose(half[right], np.broadcast_to(BACKGROUND, half[right].shape), atol=0.01)
        assert np.ptp(splats[right]) > 0.5
        assert visit.complaints == []


def test_a_file_that_ends_too_early_is_told_of(browser: Browser, wall: Content) -> None:
    """The points stay visible beside the message."""
    with serving(wall) as page, visiting(browser, page.url, WIDTH, HEIGHT, script=CUT + HOLD) as visit:
        release(visit, "rest")
        release(visit, "gpu")
        expect(visit["#message-text"]).to_contain_text("scene.ply: the file is cut short", timeout=PATIENCE)
        expect(visit["#points"]).to_be_visible(timeout=PATIENCE)
        expect(visit["#loading"]).to_be_hidden()
        visit.until_drawn()
        expect(visit["#for-now"]).to_be_hidden()


def test_a_file_dropped_while_the_scene_comes_stays(browser: Browser, wall: Content, tmp_path: Path) -> None:
    """Neither more of the scene nor all of it takes its place."""
    dropped = tmp_path / "marks.ply"
    scene = marked_scene()
    ply.write_gaussians(dropped, scene.select(np.arange(len(scene) - len(MARKS), len(scene))))
    with serving(wall) as page, visiting(browser, page.url, WIDTH, HEIGHT, script=HOLD) as visit:
        until_points(visit)
        visit.drop(dropped.name, dropped.read_bytes())
        expect(visit["#title"]).to_have_text(dropped.name)
        expect(visit["#loading"]).to_be_hidden()
        release(visit, "rest")
        assert set(marks(still(visit))) == set(MARKS)
        release(visit, "gpu")
        assert set(marks(visit.picture())) == set(MARKS)
        expect(visit["#stats"]).to_contain_text("3 splats")
        expect(visit["#title"]).to_have_text(dropped.name)
        assert visit.complaints == []


def test_a_broken_file_dropped_while_the_scene_comes_does_not_stop_it(browser: Browser, wall: Content) -> None:
    with serving(wall) as page, visiting(browser, page.url, WIDTH, HEIGHT, script=HOLD) as visit:
        until_points(visit)
        visit.drop("broken.ply", b"ply\n")
        expect(visit["#message-text"]).to_contain_text("broken.ply")
        expect(visit["#loading-text"]).to_have_text("Loading wall")
        expect(visit["#loading"]).to_be_visible()
        release(visit, "rest")
        expect(visit["#loading"]).to_be_hidden(timeout=PATIENCE)
        release(visit, "gpu")
        visit.until_drawn()
        expect(visit["#stats"]).to_contain_text("20,000 splats")
        expect(visit["#points"]).to_be_hidden()
        expect(visit["#title"]).to_have_text("wall")
        assert visit.complaints == []


def test_page_of_a_run_rests_until_its_first_scene(browser: Browser) -> None:
    with serving(LiveRun("toys")) as page, visiting(browser, page.url, WIDTH, HEIGHT) as visit:
        expect(visit["#canvas"]).to_have_attribute("aria-busy", "false", timeout=PATIENCE)
        expect(visit["#message"]).to_be_hidden()
        assert visit.complaints == []


def test_page_of_a_run_takes_the_background_of_its_capture(browser: Browser) -> None:
    """Which is read after the page was opened; what the user has chosen stays. On a phone all figures are in sight."""
    run = LiveRun("toys")

    def corner_with(number: int, background: tuple[float, float, float]) -> float:
        views = (View(f"{number}.jpg", cameras_around()[0], True),)
        run.news.post_content(replace(run.news.content, background=background, views=views))
        expect(visit["#camera-name"]).to_contain_text(f"{number}.jpg", timeout=PATIENCE)
        return float(visit.picture()[2, 2].mean())

    with serving(run) as page, visiting(browser, page.url, 390, 844, script=NO_GPU) as visit:
        expect(visit["#message"]).to_be_visible()
        run.news.post_scene(1, spz.encode(marked_scene().select(np.arange(-3, 0)), SPZ_VERSION))
        assert corner_with(1, (1.0, 1.0, 1.0)) == 1.0
        figures, card = visit["#stats"].bounding_box(), visit["#live"].bounding_box()
        assert figures
        assert card
        assert figures["y"] + figures["height"] <= card["y"]
        visit.page.keyboard.press("b")
        assert corner_with(2, (1.0, 1.0, 1.0)) == 0.0


@pytest.mark.parametrize("moves", [False, True])
def test_scene_without_cameras_stays_in_view_as_it_arrives(browser: Browser, wall: Content, moves: bool) -> None:
    """First the loaded half is centred, then the whole scene; if the user has moved, the camera stays."""
    alone = replace(wall, views=())
    with serving(alone) as page, visiting(browser, page.url, WIDTH, HEIGHT, script=HOLD) as visit:
        until_points(visit)
        if moves:
            visit.drag(60, 10)
        half = covered(still(visit))
        release(visit, "rest")
        expect(visit["#loading"]).to_be_hidden()
        whole = covered(still(visit))
        assert 0.05 < half.mean() < whole.mean()
        # What was there before is where it was only if the camera is.
        assert ((half & whole).sum() > 0.99 * half.sum()) == moves
