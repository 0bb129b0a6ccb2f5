"""The page, on a phone and on a computer."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Browser, FilePayload, Route, expect

from pocketgs.capture.synthetic import true_capture
from pocketgs.results.checkpoint import UNFINISHED
from pocketgs.results.video import write_video
from pocketgs.scene.formats import read_scene
from pocketgs.serve import shown
from serve.client import Phone
from serve.conftest import left_behind
from viewer.browsing import NO_GPU, NO_SOCKET, PATIENCE, Visit, open_browser, visiting

HARM = '<img src=x onerror="document.title=1">"\'&lt;'
PHONE, COMPUTER = (360, 740), (1280, 800)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with open_browser() as running:
        yield running


@contextmanager
def still(browser: Browser, url: str, width: int, height: int, script: str | None = None) -> Iterator[Visit]:
    """As `visiting`, by a user who wants no motion: a GPU in software would paint a moving bar most of the time."""
    with visiting(browser, url, width, height, script) as visit:
        visit.page.emulate_media(reduced_motion="reduce")
        yield visit


def payloads(files: dict[str, bytes]) -> list[FilePayload]:
    return [{"name": name, "mimeType": "", "buffer": content} for name, content in files.items()]


def choose(visit: Visit, selector: str, files: dict[str, bytes] | Path) -> None:
    """Press a button that asks for files, and give it some; large ones by the path, which is not sent through pipes."""
    with visit.page.expect_file_chooser() as chooser:
        visit[selector].click()
    chooser.value.set_files(files if isinstance(files, Path) else payloads(files))


def test_what_a_phone_offers_for_a_button(browser: Browser, serve: Callable[..., Phone]) -> None:
    """As an archive any file: iPhones know no type for .r3d, and offer only files of the types that they know."""
    with still(browser, serve().url, *PHONE) as phone:
        for kind, accepted in (("photographs", re.compile("^image/[*],")), ("archive", "")):
            choose(phone, f"[data-kind={kind}]", {"a.txt": b"hello"})
            expect(phone["#files"]).to_have_attribute("accept", accepted)
            phone["#begin [data-close]"].click()


def test_a_button_waits_until_the_computer_answers(browser: Browser, serve: Callable[..., Phone]) -> None:
    """What may be chosen is the computer's to say: until then a press would be lost."""
    with still(browser, serve().url, *PHONE) as phone:
        phone.page.route("**/shelf.json", lambda route: route.abort())
        phone.page.reload()
        phone["#connection"].wait_for()
        expect(phone["[data-kind=photographs]"]).to_be_disabled()
        phone.page.unroute("**/shelf.json")
        choose(phone, "[data-kind=photographs]", {"a.txt": b"hello"})
        phone["#begin-problem"].wait_for()


@pytest.mark.usefixtures("untrained")
def test_a_run_that_was_killed_goes_on(browser: Browser, serve: Callable[..., Phone], folder: Path) -> None:
    left_behind(folder, "failed", UNFINISHED)
    with still(browser, serve().url, *PHONE) as phone:
        expect(phone["[data-state=failed] .act"]).to_have_text("Go on")
        phone[".more"].click()
        phone["#menu [data-action=go-on]"].click()
        phone["[data-state=queued]"].wait_for()


@pytest.mark.usefixtures("untrained")
def test_the_page_refuses_what_the_computer_would(browser: Browser, serve: Callable[..., Phone]) -> None:
    """In the same words, and before a title is chosen."""
    server, photographs = serve(max_bytes=2_000_000), {f"{number}.jpg": b"a" for number in range(3)}
    choices: list[dict[str, bytes]] = [
        {**photographs, "walk.mov": b"a"},
        {"walk.mov": b"a", "back.mov": b"a"},
        {**photographs, "empty.jpg": b""},
        {"empty.mov": b""},
        {"jpg": b"a"},
        {"0.jpg": b"a", "1.jpg": b"a"},
        {f"{number}.jpg": b"a" for number in range(2001)},
        {"walk.mov": bytes(3_000_000)},
    ]
    with still(browser, server.url, *PHONE) as phone:
        for files in choices:
            choose(phone, "[data-kind=photographs]", files)
            expect(phone["#begin-problem"]).to_have_text(server.begin(files).json["error"])
            expect(phone["#begin-upload"]).to_be_disabled()
            phone["#begin [data-close]"].click()


@pytest.mark.usefixtures("untrained")
def test_a_refusal_leaves_the_files_chosen(
    browser: Browser, serve: Callable[..., Phone], photographs: dict[str, bytes]
) -> None:
    full = "the computer's disk is full"
    with still(browser, serve().url, *PHONE) as phone:
        asked: list[Route] = []
        phone.page.route("**/captures", lambda route: asked.append(route))
        choose(phone, "[data-kind=photographs]", photographs)
        phone["#begin-name"].fill("  Toys ")
        phone["#begin-effort input[value=best]"].check(force=True)
        phone["#begin-upload"].click()
        expect(phone["[data-kind=photographs]"]).to_be_disabled()
        asked[0].fulfill(status=507, json={"error": full})
        expect(phone["#begin-problem"]).to_have_text(full)
        expect(phone["[data-kind=photographs]"]).to_be_enabled()
        expect(phone["#begin-name"]).to_have_value("Toys")
        phone.page.unroute("**/captures")
        phone["#begin-upload"].click()
        expect(phone[".capture bdi"]).to_have_text("Toys")
        phone["[data-state=queued]"].wait_for(timeout=PATIENCE)


@pytest.mark.usefixtures("untrained")
def test_titles_that_the_computer_takes(browser: Browser, serve: Callable[..., Phone]) -> None:
    """Spaces alone are none; of a long name, no half of a character is taken."""
    with still(browser, serve().url, *PHONE) as phone:
        choose(phone, "[data-kind=video]", {f"x{60 * '😀'}.mov": b"no video"})
        expect(phone["#begin-name"]).to_have_value("x" + 49 * "😀")
        phone["#begin-name"].fill("   ")
        phone["#begin-upload"].click()
        expect(phone["#begin-name:invalid"]).to_be_focused()
        phone["#begin-name"].fill("x" + 49 * "😀")
        phone["#begin-upload"].click()
        expect(phone[".capture bdi"]).to_have_text("x" + 49 * "😀")


def is_within(visit: Visit) -> bool:
    """Whether the page is no wider than the window."""
    return bool(visit.page.evaluate("document.documentElement.scrollWidth <= innerWidth"))


def test_a_video_from_a_phone(browser: Browser, serve: Callable[..., Phone], tmp_path: Path) -> None:
    """It is uploaded by the phone, gets poses and is trained; both windows show that, and the scene."""
    capture = true_capture(width=192, height=144, frames=8, points=500)
    write_video(tmp_path / "walk.mp4", [frame.image for frame in sorted(capture.frames, key=lambda each: each.name)])
    url = serve().url
    with still(browser, url, *PHONE, script=NO_GPU) as phone, still(browser, url, *COMPUTER) as computer:
        choose(phone, "[data-kind=video]", tmp_path / "walk.mp4")
        phone["#begin-name"].fill(HARM)
        phone["#begin-effort input[value=quick]"].check(force=True)
        phone["#begin-upload"].click()
        phone["[data-state=training] .open:not([hidden])"].wait_for(timeout=PATIENCE)
        assert is_within(phone)
        # The phone watches, the other window waits.
        phone["[data-state=training] .open"].click()
        phone["#stage"].wait_for(timeout=PATIENCE)
        assert phone["#title"].text_content() == HARM
        phone["#stage"].filter(has_text="finished").wait_for(timeout=PATIENCE)
        phone["#stats"].filter(has_text="splats").wait_for(timeout=PATIENCE)
        computer["[data-state=trained]"].wait_for(timeout=PATIENCE)
        assert "splats" in (computer[".state"].text_content() or "")
        for visit in (phone, computer):
            visit.page.goto(url)
            visit[".open"].wait_for(timeout=PATIENCE)
            assert visit[".capture bdi"].text_content() == HARM
            assert visit.page.title() == "PocketGS"
            assert visit.page.locator(".picture img").evaluate("image => image.decode().then(() => image.naturalWidth)")
        # Saving leaves no page: an upload that goes on is not asked about.
        asked: list[str] = []
        phone.page.on("dialog", lambda dialog: (asked.append(dialog.type), dialog.accept()))
        phone.page.evaluate("() => { window.onbeforeunload = (event) => event.preventDefault(); }")
        phone[".more"].click()
        with phone.page.expect_download() as saved:
            phone["[data-suffix='.ply']"].click()
        phone.page.evaluate("() => { window.onbeforeunload = null; }")
        assert asked == []
        assert len(read_scene(Path(saved.value.path()).rename(tmp_path / "saved.ply"))) > 100
        phone[".open"].click()
        phone["#stats:not(:empty)"].wait_for(state="attached", timeout=PATIENCE)
        phone.page.go_back()
        assert phone.complaints == computer.complaints == []


@pytest.mark.usefixtures("untrained")
def test_what_a_page_can_do(browser: Browser, serve: Callable[..., Phone], photographs: dict[str, bytes]) -> None:
    """Upload, rename, delete, undo and restore; with harmful titles and names of files."""
    url = serve().url
    with still(browser, url, *PHONE) as phone:
        choose(phone, "[data-kind=photographs]", {"a.txt": b"hello"})
        assert phone["#begin-problem"].text_content() == "a.txt is no photograph, video or zip file"
        assert phone["#begin-upload"].is_disabled()
        phone["#begin [data-close]"].click()
        choose(phone, "[data-kind=photographs]", photographs)
        phone["#begin-upload"].click()
        phone["[data-state=queued]"].wait_for(timeout=PATIENCE)
        for title in (HARM, "x" * 100):
            phone[".more"].click()
            phone["[data-action=rename]"].click()
            phone["#rename-name"].fill(title)
            phone["#rename .main"].click()
            phone[".capture bdi"].filter(has_text=title).wait_for()
            assert is_within(phone)
        phone[".more"].click()
        phone["[data-action=delete]"].click()
        phone["#toast"].wait_for()
        phone[".capture"].wait_for(state="detached")
        assert phone.page.evaluate("document.activeElement.dataset.kind") == "photographs", "the focus has a place"
        undo = phone["#undo"].bounding_box()
        assert undo
        assert undo["width"] > undo["height"], "a long title leaves it room"
        phone["#undo"].click()
        phone[".capture"].wait_for()
        phone[".more"].click()
        phone["[data-action=delete]"].click()
        phone["#trash summary"].click()
        phone["#trash li button"].click()
        phone["[data-state=queued]"].wait_for()
        assert phone.page.evaluate("document.activeElement.dataset.kind") == "photographs"
        choose(phone, "[data-kind=video]", {f"{HARM[:-4]}.mov": b"no video"})
        phone["#begin-upload"].click()
        unusable = phone["[data-state=unusable] .message"].filter(has_text="cannot be opened as a video")
        unusable.wait_for(timeout=PATIENCE)
        phone["[data-action=check]"].click()
        phone["[data-state=checking]"].wait_for()
        unusable.wait_for(timeout=PATIENCE)
        for role in ("button", "progressbar"):
            named = phone.page.get_by_role(role, name="x" * 100, include_hidden=True)
            assert named.count() == 1
        phone.page.route("**/delete", lambda route: route.abort())
        phone[".more"].first.click()
        phone["[data-action=delete]"].click()
        phone["#toast span"].filter(has_text="the computer does not answer").wait_for()
        assert phone.page.locator(".capture img").count() == 2, "no markup came from a title"
        assert phone.page.title() == "PocketGS"
        assert [each for each in phone.complaints if "404" not in each and "ERR_FAILED" not in each] == []


@pytest.mark.usefixtures("untrained")
def test_an_upload_that_is_interrupted(
    browser: Browser, serve: Callable[..., Phone], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The network fails, and it goes on by itself; the page is closed, and it goes on with the same file."""
    monkeypatch.setattr(shown, "SECONDS_ACTIVE", 1.0)
    content = bytes(range(251)) * 12_000
    video, other, differing = (tmp_path / name for name in ("walk.mov", "other.mov", "differing/walk.mov"))
    differing.parent.mkdir()
    for path, written in ((video, content), (other, content), (differing, bytes(len(content)))):
        path.write_bytes(written)
    server = serve()
    with still(browser, server.url, *PHONE) as phone:
        asked = 0

        def interrupt(route: Route) -> None:
            nonlocal asked
            asked += 1
            route.continue_() if asked == 2 else route.abort()

        phone.page.route("**/files/**", interrupt)
        choose(phone, "[data-kind=video]", video)
        phone["#begin-upload"].click()
        phone[".state"].filter(has_text="69").wait_for(timeout=PATIENCE)
    [told] = server.shelf["captures"]
    assert (told["state"], told["received"]) == ("uploading", 1 << 21)
    with still(browser, server.url, *PHONE, script=NO_GPU) as phone:
        phone["[data-action=continue]"].wait_for(timeout=PATIENCE)
        choose(phone, "[data-action=continue]", other)
        phone["#toast span"].filter(has_text="other files").wait_for()
        choose(phone, "[data-action=continue]", differing)
        phone["#toast span"].filter(has_text="its beginning differs").wait_for()
        choose(phone, "[data-action=continue]", video)
        phone["[data-state=unusable]"].wait_for(timeout=PATIENCE)
    path = next((tmp_path / "shelf" / "captures").glob("*/upload/0001.mov"))
    assert path.read_bytes() == content


@pytest.mark.usefixtures("untrained")
def test_answers_that_break_off(browser: Browser, serve: Callable[..., Phone], tmp_path: Path) -> None:
    """They count as none: the piece is sent again, and the page says that the computer does not answer."""
    content, video = bytes(range(251)) * 12_000, tmp_path / "walk.mov"
    video.write_bytes(content)
    with still(browser, serve().url, *PHONE) as phone:
        asked = 0

        def break_off(route: Route) -> None:
            nonlocal asked
            asked += 1
            route.fulfill(status=200, body='{"rece') if asked == 1 else route.continue_()

        phone.page.route("**/files/*?offset=*", break_off)
        choose(phone, "[data-kind=video]", video)
        phone["#begin-upload"].click()
        phone["[data-state=unusable]"].wait_for(timeout=PATIENCE)
        assert asked == 3
        expect(phone["#connection"]).to_be_hidden()
        phone.page.route("**/shelf.json", lambda route: route.fulfill(status=200, body='{"capt'))
        expect(phone["#connection"]).to_be_visible()
        phone.page.unroute("**/shelf.json")
        expect(phone["#connection"]).to_be_hidden()
        assert phone.complaints == []
    path = next((tmp_path / "shelf" / "captures").glob("*/upload/0001.mov"))
    assert path.read_bytes() == content


@pytest.mark.usefixtures("untrained")
def test_an_upload_whose_file_is_gone(browser: Browser, serve: Callable[..., Phone], tmp_path: Path) -> None:
    """The phone has deleted its temporary copy: no retry helps. A piece that came too late is sent again."""
    server, video = serve(), tmp_path / "walk.mov"
    video.write_bytes(bytes(5_000_000))
    with still(browser, server.url, *PHONE) as phone:
        asked = 0

        def answer(route: Route) -> None:
            nonlocal asked
            asked += 1
            if asked == 1:
                route.fulfill(status=408, json={"error": "the rest of the request did not arrive"})
            else:
                video.unlink(missing_ok=True)
                route.continue_()

        phone.page.route("**/files/**", answer)
        with phone.page.expect_file_chooser() as chooser:
            phone["[data-kind=video]"].click()
        chooser.value.set_files(video)
        phone["#begin-upload"].click()
        sentence = "walk.mov cannot be read any more: choose the same files again"
        expect(phone["#toast span"]).to_have_text(sentence, timeout=PATIENCE)
    [told] = server.shelf["captures"]
    assert (told["state"], told["received"]) == ("uploading", 1 << 21)


@pytest.mark.usefixtures("untrained")
def test_an_upload_that_is_deleted_elsewhere(
    browser: Browser, serve: Callable[..., Phone], photographs: dict[str, bytes]
) -> None:
    """It ends, says so, and sends no more files."""
    server = serve()
    with still(browser, server.url, *PHONE) as phone:
        asked = 0

        def delete(route: Route) -> None:
            nonlocal asked
            asked += 1
            for capture in server.shelf["captures"]:
                server.tell(f"captures/{capture['id']}/delete")
            route.continue_()

        phone.page.route("**/files/*?offset=*", delete)
        choose(phone, "[data-kind=photographs]", photographs)
        phone["#begin-upload"].click()
        expect(phone["#toast span"]).to_have_text("no such capture: it was deleted", timeout=PATIENCE)
    assert asked == 1


def test_a_phone_without_sockets(browser: Browser, serve: Callable[..., Phone], zipped: bytes) -> None:
    """It watches a run by requests all the same, pauses it, and stops it.

    A run that is paused holds up the queue, so the list says how to go on; another window, with sockets, does.
    """
    server = serve()
    identity = server.upload({"toys.zip": zipped}, effort="best")
    server.until(identity, lambda capture: capture["state"] == "training" and capture["progress"]["iteration"] > 0)
    with still(browser, server.url, *PHONE, script=NO_GPU + NO_SOCKET) as phone:
        phone[".open"].click()
        expect(phone["#stats"]).to_contain_text("splats", timeout=PATIENCE)
        expect(phone["#loss"]).not_to_have_text("–")
        phone["#message-close"].click()
        phone["#pause"].click()
        expect(phone["#stage"]).to_have_text("paused", timeout=PATIENCE)
        server.until(identity, lambda capture: capture["progress"]["paused"])
        with still(browser, server.url, *COMPUTER, script=NO_GPU) as computer:
            sentence = re.compile(r"paused at \d+ of 1000000: open Watch to resume")
            expect(computer[".state"]).to_have_text(sentence, timeout=PATIENCE)
            computer[".open"].click()
            expect(computer["#stage"]).to_have_text("paused", timeout=PATIENCE)
            computer["#pause"].click()
            expect(phone["#stage"]).to_have_text("training", timeout=PATIENCE)
        phone["#pause"].click()
        expect(phone["#stage"]).to_have_text("paused", timeout=PATIENCE)
        phone["#pause"].click()
        expect(phone["#stage"]).to_have_text("training", timeout=PATIENCE)
        phone["#stop"].click()
        server.until(identity, "trained")
        # Either it has learnt of the end, or it shows the result since the run is gone.
        expect(phone["#live-buttons"]).to_be_hidden(timeout=PATIENCE)
        expect(phone["#stage"]).to_have_text(re.compile("finished|starting"), timeout=PATIENCE)
