"""Points stay where the GPU draws no splats: there is none, it does not hold the scene, or it is lost."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from pocketgs.scene.formats import ply, splat
from pocketgs.scene.gaussians import Gaussians
from pocketgs.viewer.content import Content, View
from pocketgs.viewer.server import serving
from viewer.browsing import NO_GPU, PATIENCE, Visit, visiting
from viewer.marks import HEIGHT, MARKS, UP, WIDTH, cameras_around, marked_scene, marks, psnr

BACKGROUND = (0.1, 0.2, 0.3)

KEPT_GPU = """
const requestDevice = GPUAdapter.prototype.requestDevice;
GPUAdapter.prototype.requestDevice = async function (...options) {
    return (window.device = await requestDevice.apply(this, options));
};
"""
"""Keeps the GPU where a test can take it away."""


def small_gpu(bytes_of_buffer: int) -> str:
    """A GPU whose buffers are no larger."""
    return f"""
    for (const name of ["maxBufferSize", "maxStorageBufferBindingSize"]) {{
        Object.defineProperty(GPUSupportedLimits.prototype, name, {{ get: () => {bytes_of_buffer} }});
    }}
    """


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> Content:
    path = tmp_path_factory.mktemp("shown") / "scene.ply"
    ply.write_gaussians(path, marked_scene())
    rendering = path.with_name("0001.png")
    Image.new("RGB", (200, 100), "teal").save(rendering)
    views = tuple(View(f"{i}.jpg", camera, i == 1) for i, camera in enumerate(cameras_around()))
    return Content("marks", path, False, BACKGROUND, views, UP, (0.0, 0.0, 0.0), {"0001.png": rendering})


@pytest.fixture(scope="module")
def url(content: Content) -> Iterator[str]:
    with serving(content) as page:
        yield page.url


def expect_points_only(visit: Visit) -> None:
    """Points are final, and there are no buttons for other appearances."""
    expect(visit["#points"]).to_be_visible(timeout=PATIENCE)
    expect(visit["#for-now"]).to_be_hidden()
    expect(visit["#appearances"]).to_be_hidden()
    visit.until_drawn()


def test_points_stay_where_the_gpu_cannot_hold_the_scene(browser: Browser, url: str, content: Content) -> None:
    """It is told, but not again of the next scene."""
    assert content.scene
    with visiting(browser, url, WIDTH, HEIGHT, script=small_gpu(1000)) as visit:
        expect(visit["#message-text"]).to_contain_text("expected a smaller scene", timeout=PATIENCE)
        expect_points_only(visit)
        picture = visit.picture()
        assert psnr(visit.seen(), picture) > 40
        visit["#message-close"].evaluate("button => button.click()")
        visit.drop("again.ply", content.scene.read_bytes())
        expect(visit["#title"]).to_have_text("again.ply")
        expect_points_only(visit)
        expect(visit["#message"]).to_have_attribute("hidden", "")
        assert visit.complaints == []


def test_points_show_what_the_gpu_cannot_hold_until_a_scene_comes_that_it_can(
    browser: Browser, url: str, tmp_path: Path
) -> None:
    scene = marked_scene()
    ply.write_gaussians(tmp_path / "small.ply", scene.select(np.arange(len(scene) - len(MARKS), len(scene))))
    rng, count = np.random.default_rng(7), 80_000
    large = Gaussians(
        rng.normal(0, 1, (count, 3)),
        np.full((count, 3), -5.0),
        np.tile((1.0, 0.0, 0.0, 0.0), (count, 1)),
        np.full(count, 3.0),
        rng.normal(0, 1, (count, 1, 3)),
    )
    splat.write_gaussians(tmp_path / "large.splat", large)
    with visiting(browser, url, WIDTH, HEIGHT, script=small_gpu(2_000_000)) as visit:
        visit.until_drawn()
        expect(visit["#points"]).to_be_hidden()
        visit.drop("large.splat", (tmp_path / "large.splat").read_bytes())
        expect(visit["#message-text"]).to_contain_text("expected a smaller scene", timeout=PATIENCE)
        expect(visit["#title"]).to_have_text("large.splat")
        expect_points_only(visit)
        expect(visit["#stats"]).to_contain_text("80,000 splats")
        assert np.ptp(visit.picture()) > 0.5
        visit.drop("small.ply", (tmp_path / "small.ply").read_bytes())
        expect(visit["#points"]).to_be_hidden(timeout=PATIENCE)
        expect(visit["#appearances"]).to_be_visible()
        expect(visit["#message"]).to_be_hidden()
        assert set(marks(visit.picture())) == set(MARKS)
        expect(visit["#stats"]).to_have_text(re.compile("^3 splats"))
        assert visit.complaints == []


def test_a_gpu_that_is_lost_is_taken_anew(browser: Browser, url: str) -> None:
    """At half the resolution, with a line that says so."""
    with visiting(browser, url, WIDTH, HEIGHT, script=KEPT_GPU) as visit:
        visit.drag(30, 0)
        before = visit.picture()
        expect(visit["#note"]).to_be_empty()
        visit.page.evaluate("device.destroy()")
        expect(visit["#note"]).to_have_text("the GPU was lost: now at 50 % resolution", timeout=PATIENCE)
        expect(visit["#points"]).to_be_hidden(timeout=PATIENCE)
        after = visit.picture()
        assert 25 < psnr(after, before) < 60
        for name, place in marks(before).items():
            np.testing.assert_allclose(marks(after)[name], place, atol=0.7, err_msg=name)
        visit.drag(30, 0)
        assert marks(visit.picture())["red"][0] > marks(after)["red"][0] + 5
        expect(visit["#message"]).to_be_hidden()


def test_points_take_over_from_a_gpu_that_does_not_come_back(browser: Browser, url: str, content: Content) -> None:
    """It is told, and the GPU is not tried again."""
    assert content.scene
    with visiting(browser, url, WIDTH, HEIGHT, script=KEPT_GPU) as visit:
        visit.drag(30, 0)
        before = marks(visit.picture())
        visit.page.evaluate("GPU.prototype.requestAdapter = async () => null; device.destroy()")
        expect(visit["#message-text"]).to_contain_text("the GPU was lost", timeout=PATIENCE)
        expect_points_only(visit)
        after = marks(visit.picture())
        for name, place in before.items():
            np.testing.assert_allclose(after[name], place, atol=1.5, err_msg=name)
        visit["#message-close"].click()
        visit.drag(30, 0)
        assert marks(visit.picture())["red"][0] > after["red"][0] + 5
        visit.drop("again.ply", content.scene.read_bytes())
        expect(visit["#title"]).to_have_text("again.ply")
        expect_points_only(visit)
        expect(visit["#message"]).to_be_hidden()


LOSE = """async () => {
    const { SceneRenderer } = await import(new URL("page/drawing/scene_renderer.js", document.baseURI));
    const said = [];
    let lose;
    const open = async () => ({
        lost: new Promise((resolve) => (lose = () => resolve({ message: "gone" }))),
        setAppearance: async () => {},
        setScene: async () => {},
        draw: async () => true,
    });
    const points = { setScene() {}, release() {}, draw: async () => true };
    let done = Promise.resolve();
    const renderer = new SceneRenderer(points, {
        pictureNow: (share) => ({ share }),
        onChange() {},
        onTakeOver() {},
        onRegaining: (regaining) => (done = regaining),
        onNote: (text) => said.push(text),
        onFault: (text) => said.push(text),
    });
    await renderer.useGpu(await open(), open);
    await renderer.setScene({ count: 1 });
    const shares = [renderer.largestShare];
    for (let i = 0; i < 4; i++) {
        lose();
        await new Promise((resolve) => setTimeout(resolve));
        await done;
        shares.push(renderer.largestShare);
    }
    return [shares, said, renderer.compositor];
}"""


FAIL = """async () => {
    const { Renderer } = await import(new URL("page/drawing/renderer.js", document.baseURI));
    let open = 0;
    const device = {
        addEventListener() {},
        createShaderModule() {
            throw new Error("no shader");
        },
        destroy: () => open--,
    };
    const requestDevice = async () => open++ || device;
    const gpu = { requestAdapter: async () => ({ limits: {}, requestDevice }) };
    Object.defineProperty(navigator, "gpu", { value: gpu, configurable: true });
    const failure = await Renderer.open(document.createElement("canvas"), () => {}).catch(({ message }) => message);
    delete navigator.gpu;
    return [typeof failure, open];
}"""


def test_a_gpu_on_which_shaders_fail_does_not_stay_open(page: Page) -> None:
    assert page.evaluate(FAIL) == ["string", 0]


def test_a_gpu_that_is_lost_again_and_again_is_left_alone(page: Page) -> None:
    """Until then each loss halves the resolution."""
    shares, said, compositor = page.evaluate(LOSE)
    assert shares[:4] == [1, 0.5, 0.25, 0.125]
    assert said[:3] == [f"the GPU was lost: now at {n} % resolution" for n in (50, 25, 12.5)]
    assert said[3:] == ["", "the GPU was lost (gone): reload the page"]
    assert compositor == "points"


def test_without_webgpu_points_stay(browser: Browser, url: str) -> None:
    """They follow the pointer, the button saves them, and a message says why there are no splats."""
    with visiting(browser, url, WIDTH, 640, script=NO_GPU) as visit:
        expect(visit["#message-text"]).to_contain_text("points")
        expect(visit["#message-text"]).to_contain_text("WebGPU")
        expect(visit["#message-text"]).to_contain_text("Chrome")
        picture = visit["#previews img"]
        picture.scroll_into_view_if_needed()
        expect(picture).to_have_count(1)
        expect(picture).to_have_js_property("complete", True)
        assert picture.evaluate("image => image.naturalWidth") > 100
        visit["#message-close"].click()
        expect(visit["#previews"]).to_be_hidden()
        expect_points_only(visit)
        before = marks(visit.picture(), ["red"])
        visit.drag(30, 0)
        assert marks(visit.picture(), ["red"])["red"][0] > before["red"][0] + 5
        np.testing.assert_allclose(visit.seen(), visit.picture(), atol=0.01)
        assert visit.complaints == []


def test_pictures_are_shown_with_no_other_message(browser: Browser, url: str) -> None:
    """Shown again when a run has made new previews."""
    with visiting(browser, url, WIDTH, 640, script=NO_GPU) as visit:
        expect(visit["#previews"]).to_be_visible()
        visit.drop("broken.ply", b"ply\n")
        expect(visit["#message-text"]).to_contain_text("broken.ply")
        expect(visit["#previews"]).to_be_hidden()
        visit["#message-close"].click()
        show = """async (previews) => {
            const { showPreviews } = await import(new URL("page/messages/messages.js", document.baseURI));
            showPreviews(previews);
        }"""
        visit.page.evaluate(show, [])
        expect(visit["#message"]).to_be_hidden()
        visit.page.evaluate(show, ["previews/0001.png", "previews/0001.png"])
        expect(visit["#message-text"]).to_contain_text("WebGPU")
        expect(visit["#previews img"]).to_have_count(2)
        expect(visit["#previews"]).to_be_visible()
        assert visit.complaints == []
