"""Scenes that are drawn without sorting on the page: it reads them, draws them as Python does, and says so."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator
from pathlib import Path
from random import Random

import numpy as np
import pytest
from playwright.sync_api import Browser, Error, Page, expect

from attack.mutations import broken_sections
from pocketgs.geometry.camera import Camera
from pocketgs.scene.formats.pgs_sections import Section, join_sections, split_sections
from pocketgs.sort_free.drawing import SortFreeDrawing
from pocketgs.sort_free.file import read_sort_free, write_sort_free
from pocketgs.sort_free.forms import FORMS
from pocketgs.sort_free.pgs_file import KNOWN, encode
from pocketgs.sort_free.scene import SortFreeScene, sort_free
from pocketgs.viewer.content import Content, View
from pocketgs.viewer.server import serving
from scene.formats.scenes import random_scene
from sort_free.test_files import with_weights
from viewer.browsing import PATIENCE, visiting
from viewer.marks import HEIGHT, UP, WIDTH, cameras_around, marked_scene, psnr

BACKGROUND = (0.1, 0.2, 0.3)

READ = """async ([name, content]) => {
    const { readScene } = await import(new URL("page/formats/scene_file.js", document.baseURI));
    const bytes = Uint8Array.from(atob(content), (character) => character.charCodeAt(0));
    const { count, weighting } = await readScene(name, new Blob([bytes]).stream(), bytes.length);
    return [count, weighting?.form, weighting?.uniform, Array.from(weighting?.views ?? [])];
}"""


def read(page: Page, name: str, content: bytes) -> tuple[int, str, dict[str, float], list[float]]:
    found: tuple[int, str, dict[str, float], list[float]] = page.evaluate(
        READ, [name, base64.b64encode(content).decode()]
    )
    return found


@pytest.mark.parametrize("suffix", ["ply", "pgs"])
@pytest.mark.parametrize("form", FORMS)
def test_page_reads_what_python_reads(page: Page, tmp_path: Path, form: str, suffix: str) -> None:
    path = tmp_path / f"scene.{suffix}"
    write_sort_free(path, with_weights(random_scene(300, 1), form))
    expected = read_sort_free(path)
    count, name, uniform, views = read(page, path.name, path.read_bytes())
    assert (count, name) == (300, form)
    np.testing.assert_allclose(np.reshape(views, (-1, 300)).T, expected.visibility_sh, atol=1e-5)
    numbers = dict(zip(expected.form.numbers, np.exp(expected.log_shared), strict=True))
    wanted = {"sigma": 0, "beta": 0, "background": 0, **numbers, "unit": 3.7}
    assert uniform == pytest.approx({**wanted, "view_coefficients": expected.visibility_sh.shape[1]})


def test_page_refuses_broken_weights(page: Page, tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    write_sort_free(path, with_weights(random_scene(60, 0), "visibility"))
    content = path.read_bytes()
    for old, new, told in (
        (b"sort_free visibility", b"sort_free magic", "'magic': not known, expected one of direct, exponential, lc"),
        (b"sort_free_unit 3.7", b"sort_free_unit -1", "unit -1, expected"),
        (b"sort_free_sigma", b"sort_free_sigh", "numbers NaN, expected 1"),
        (b"view_3", b"view_9", "3 coefficients of each weight, expected 1 or 4"),
    ):
        with pytest.raises(Error, match=told):
            read(page, path.name, content.replace(old, new))
    write_sort_free(tmp_path / "scene.pgs", read_sort_free(path))
    parts = split_sections(path, (tmp_path / "scene.pgs").read_bytes(), KNOWN)
    for name, broken, told in (
        ("weights", parts["weights"][:20], "too short"),
        ("weights", parts["weights"] + bytes(8), "bytes for 1 numbers"),
        ("weights", b"magic".ljust(16, b"\0") + parts["weights"][16:], "'magic': not known"),
        ("view", None, 'section "view" of the .pgs is missing'),
        ("weights", None, 'section "weights" of the .pgs is missing'),
    ):
        changed = {**parts, name: broken}
        sections = [Section(each, dict(KNOWN)[each], part) for each, part in changed.items() if part is not None]
        with pytest.raises(Error, match=told):
            read(page, "scene.pgs", join_sections(sections))


def test_broken_sections_are_read_or_refused(page: Page) -> None:
    whole = encode(with_weights(random_scene(40, 1), "lc"))
    outcomes = set()
    for number in range(60):
        try:
            read(page, "scene.pgs", broken_sections(Random(number), whole))
            outcomes.add("read")
        except Error as error:
            outcomes.add("refused" if "scene.pgs" in str(error) else str(error))
    assert outcomes == {"read", "refused"}


@pytest.fixture(scope="module")
def cameras() -> list[Camera]:
    return cameras_around()


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> SortFreeScene:
    """As a .pgs holds it."""
    gaussians = marked_scene()
    scene, rng = sort_free(gaussians, "visibility", 3.0, 2), np.random.default_rng(0)
    scene.visibility_sh[:] = rng.normal(0.0, 1.0, scene.visibility_sh.shape)
    path = tmp_path_factory.mktemp("rounded") / "scene.pgs"
    write_sort_free(path, scene)
    return read_sort_free(path)


@pytest.fixture(scope="module")
def url(scene: SortFreeScene, cameras: list[Camera], tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    path = tmp_path_factory.mktemp("shown") / "scene.pgs"
    write_sort_free(path, scene)
    views = tuple(View(f"{i}.jpg", camera, i == 1) for i, camera in enumerate(cameras))
    with serving(Content("free", path, False, BACKGROUND, views, UP, (0.0, 0.0, 0.0))) as page:
        yield page.url


def test_picture_is_pythons(
    browser: Browser, url: str, scene: SortFreeScene, cameras: list[Camera], tmp_path: Path
) -> None:
    """Of a .pgs that it loads; then a sorted .ply is dropped. Depths are there too."""
    drawing = SortFreeDrawing(scene)
    with visiting(browser, url, WIDTH, HEIGHT) as visit:
        for number in (1, 2):
            expected = np.clip(drawing.render(cameras[number], BACKGROUND).image, 0, 1)
            assert psnr(visit.picture(), expected) > 40
            expect(visit["#stats"]).to_contain_text("sort-free: visibility · ")
            visit["#next"].click()
        visit["#previous"].click()
        visit.page.keyboard.press("4")
        assert np.ptp(visit.picture().sum(axis=2)) > 1.0
        visit.page.keyboard.press("1")
        path = tmp_path / "sorted.ply"
        marked_scene().save(path)
        visit.drop(path.name, path.read_bytes())
        size = math.ceil(path.stat().st_size / 1e3)
        expect(visit["#stats"]).to_contain_text(f"splats · sorted · {size} KB · ", timeout=PATIENCE)
        assert visit.complaints == []
