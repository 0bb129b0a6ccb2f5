"""The page around the worker, which here answers at once: small windows, keys, scenes that are not saved."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Dialog, Route, expect

from static_site.hosting import Host
from viewer.browsing import Visit, visiting

WORKER = """
const text = "Takes about 162 MB, 101 MB of it in buffers of the GPU. ".repeat(4);
const scene = Object.fromEntries(["ply", "spz", "pgs"].map((format) => [format, new Blob([format])]));
const pose = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
const camera = { width: 3, height: 2, fx: 3, fy: 3, cx: 1.5, cy: 1, world_to_camera: pose };
const first = { camera, rgba: new Uint8ClampedArray(24), target: [0, 0, 1], up: [0, -1, 0] };
const progress = { iteration: 1, loss: 1, held_out_psnr: 20, rate: 1, gaussians: 9, bytes: 9 };
const tell = (type, content = {}) => postMessage({ type, ...content });
self.addEventListener("message", ({ data: { type, picked } }) => {
    if (type === "train") {
        tell("stage", { text: "depth of keyframe 3 of 40", share: 0.1 });
        tell("plan", { text });
        tell("first", first);
        tell("complaint", { text: "one" });
        tell("complaint", { text: "another" });
        tell("complaint", { text: "one" });
    }
    if (["pause", "resume"].includes(type) || picked?.name === "trains") {
        tell("progress", progress);
    } else if (type === "train" && picked.name !== "endless") {
        tell("progress", progress);
        const { name } = picked;
        const iteration = name === "half" ? 4 : 9;
        tell("kept", { found: name === "lost" ? null : { name, iteration, iterations: 9, canGoOn: true } });
        tell("done", { scene, isKept: name !== "lost" });
    }
});
tell("settings", { run: { iterations: 9, gaussians: 9 }, plan: { most_memory: 900 } });
"""


@pytest.fixture
def visit(browser: Browser, host: Host) -> Iterator[Visit]:
    with visiting(browser, "about:blank", 844, 340) as visit:
        visit.page.context.route(
            "**/worker.js", lambda route: route.fulfill(body=WORKER, content_type="text/javascript")
        )
        visit.page.add_init_script("navigator.storage.persist = async () => true")
        visit.page.goto(host.address)
        visit["#start"].wait_for()
        yield visit


def asked(visit: Visit, answers: list[bool]) -> list[str]:
    """Answer the page's questions in turn. Returns a list that fills with their kinds."""
    kinds: list[str] = []

    def answer(dialog: Dialog) -> None:
        kinds.append(dialog.type)
        if answers.pop(0):
            dialog.accept()
        else:
            dialog.dismiss()

    visit.page.on("dialog", answer)
    return kinds


def test_a_phone_held_sideways_reaches_everything(visit: Visit) -> None:
    visit["#refines"].uncheck(timeout=2000)
    visit["#choose-archive"].click(timeout=2000, trial=True)
    visit.drop("endless.zip", b"")
    visit["#message-close"].click()
    visit["#cancel"].click(timeout=2000, trial=True)
    expect(visit["#curves"]).to_be_hidden()
    visit.page.set_viewport_size({"width": 390, "height": 844})
    visit["#cancel"].click(timeout=2000, trial=True)
    expect(visit["#curves"]).to_be_visible()


def test_the_picture_shows_that_it_has_the_focus(visit: Visit) -> None:
    visit.drop("kept.zip", b"")
    visit["#message-close"].click()
    visit["#another"].focus()
    for _ in range(20):
        visit.page.keyboard.press("Tab")
        if visit.page.evaluate("document.activeElement.id") == "picture":
            break
    assert visit["#picture"].evaluate("(element) => getComputedStyle(element).outlineStyle") == "solid"
    expect(visit["#photograph-figure"]).to_be_visible()
    visit.page.keyboard.press("ArrowLeft")
    expect(visit["#photograph-figure"]).to_be_hidden()
    expect(visit["#picture"]).to_have_attribute("aria-label", re.compile("arrow keys"))


def test_one_complaint_does_not_hide_another(visit: Visit) -> None:
    visit.drop("kept.zip", b"")
    expect(visit["#message-text"]).to_have_text("one\n\nanother")


def test_a_scene_that_would_be_lost_is_asked_about(visit: Visit) -> None:
    answers = [False, True, False]
    kinds = asked(visit, answers)
    visit.drop("lost.zip", b"")
    visit["#save-ply"].wait_for()
    visit.drop("kept.zip", b"")
    assert kinds == ["confirm"]
    expect(visit["#title"]).to_have_text("lost")
    visit.drop("kept.zip", b"")
    assert kinds == ["confirm"] * 2
    expect(visit["#title"]).to_have_text("kept")
    save_ply(visit)
    assert leaving(visit) == [False, ""]
    visit.drop("lost.zip", b"")
    expect(visit["#title"]).to_have_text("lost")
    visit["#message-close"].click()
    prevented, text = leaving(visit)
    assert prevented
    assert text, "older browsers ask only for a text"
    visit.page.close(run_before_unload=True)
    visit.page.wait_for_timeout(500)
    assert kinds == ["confirm"] * 2 + ["beforeunload"]
    save_ply(visit)
    visit.drop("kept.zip", b"")
    expect(visit["#title"]).to_have_text("kept")
    assert answers == []


def leaving(visit: Visit) -> list[object]:
    """Whether the page wants to be asked about before it is left, and the text that it gives."""
    return visit.page.evaluate(
        """() => {
            const event = document.createEvent("BeforeUnloadEvent");
            event.initEvent("beforeunload", false, true);
            dispatchEvent(event);
            return [event.defaultPrevented, event.returnValue];
        }"""
    )


def test_a_scene_in_storage_that_may_be_deleted_is_not_safe(visit: Visit) -> None:
    visit.page.evaluate("() => { navigator.storage.persist = async () => false; }")
    visit.drop("kept.zip", b"")
    visit["#save-ply"].wait_for()
    assert leaving(visit)[0]
    save_ply(visit)
    assert leaving(visit) == [False, ""]


def test_the_way_back_to_a_scene(visit: Visit) -> None:
    """On phones the card for another capture covers the buttons that save this one."""
    visit.page.set_viewport_size({"width": 390, "height": 844})
    expect(visit["#back"]).to_be_hidden()
    visit.page.keyboard.press("Escape")
    expect(visit["#start"]).to_be_visible()
    visit.drop("kept.zip", b"")
    visit["#message-close"].click()
    for way_back in (visit["#back"].click, lambda: visit.page.keyboard.press("Escape")):
        visit["#another"].click()
        expect(visit["#choose-archive"]).to_be_focused()
        way_back()
        expect(visit["#another"]).to_be_focused()
        visit["#save-ply"].click(timeout=2000, trial=True)


def test_what_listeners_and_keyboards_follow(visit: Visit) -> None:
    """Stages are announced without how far they are, and the focus goes where the next button is."""
    visit["#choose-archive"].focus()
    visit.drop("endless.zip", b"")
    expect(visit["#cancel"]).to_be_focused()
    expect(visit["#announced"]).to_have_text("depth of keyframe")
    expect(visit["#announced"]).to_have_attribute("role", "status")
    visit.page.reload()
    visit["#start"].wait_for()
    visit["#choose-archive"].focus()
    visit.drop("kept.zip", b"")
    expect(visit["#save-ply"]).to_be_focused()
    expect(visit["#announced"]).to_have_text("done")


def test_a_run_that_is_paused_says_so(visit: Visit) -> None:
    """Also while the steps that were under way are reported."""
    visit.drop("trains.zip", b"")
    visit["#message-close"].click()
    for button, stage in (("Resume", "paused"), ("Pause", "training")):
        visit["#pause"].click()
        expect(visit["#pause"]).to_have_text(button)
        visit.page.wait_for_timeout(100)
        expect(visit["#stage"]).to_have_text(stage)
        expect(visit["#announced"]).to_have_text(stage)


def test_any_file_can_be_chosen_as_an_archive(visit: Visit) -> None:
    """Phones that know no type for .r3d would offer no such file."""
    assert visit["#archive-input"].get_attribute("accept") is None


def test_what_is_dropped_while_the_page_loads_waits(browser: Browser, host: Host) -> None:
    held: list[Route] = []
    with visiting(browser, "about:blank", 844, 640) as visit:
        visit.page.context.route("**/worker.js", lambda route: held.append(route))
        visit.page.goto(host.address)
        visit.drop("endless.zip", b"")
        visit.page.wait_for_timeout(500)
        expect(visit["#start"]).to_be_hidden()
        expect(visit["#message"]).to_be_hidden()
        [route] = held
        route.fulfill(body=WORKER, content_type="text/javascript")
        expect(visit["#title"]).to_have_text("endless")
        visit["#message-close"].click()
        visit["#cancel"].click(timeout=2000, trial=True)


def save_ply(visit: Visit) -> None:
    if visit["#message"].is_visible():
        visit["#message-close"].click()
    with visit.page.expect_download():
        visit["#save-ply"].click()


def test_a_kept_run_is_not_replaced_without_asking(visit: Visit) -> None:
    """Unless it is finished and saved."""
    answers = [False, False]
    kinds = asked(visit, answers)
    visit.drop("kept.zip", b"")
    visit["#save-ply"].wait_for()
    visit.drop("half.zip", b"")
    assert kinds == ["confirm"]
    expect(visit["#title"]).to_have_text("kept")
    save_ply(visit)
    visit.drop("half.zip", b"")
    expect(visit["#title"]).to_have_text("half")
    save_ply(visit)
    visit.drop("kept.zip", b"")
    assert kinds == ["confirm"] * 2
    expect(visit["#title"]).to_have_text("half")


def test_a_share_that_is_cancelled_saves_nothing(visit: Visit) -> None:
    kinds = asked(visit, [False])
    visit.page.evaluate(
        """() => {
            navigator.canShare = () => true;
            navigator.share = async () => {
                throw new DOMException("", "AbortError");
            };
        }"""
    )
    visit.drop("lost.zip", b"")
    visit["#message-close"].click()
    visit["#save-ply"].click()
    visit.drop("kept.zip", b"")
    assert kinds == ["confirm"]
    expect(visit["#title"]).to_have_text("lost")
