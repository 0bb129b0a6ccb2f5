"""`pocketgs site`: small, whole, and careful with what is there already."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from pocketgs.cli import main
from pocketgs.errors import PocketGSError
from pocketgs.site import write
from pocketgs.site.files import SEQUENCES
from pocketgs.site.write import write_site
from pocketgs.splat.webgpu.passes import describe_training
from pocketgs.splat.webgpu.variant import Variant
from static_site.versions import another_page

MOST_BYTES = 1_000_000
IMPORT = re.compile(r"""(?:from |new URL\()"([./\w]+\.js)\"""")


def test_it_is_small(site: Path) -> None:
    files = [path for path in site.rglob("*") if path.is_file() and ".pocketgs" not in path.parts]
    assert sum(path.stat().st_size for path in files) < MOST_BYTES


def test_every_import_leads_to_a_file_and_no_module_is_left_over(site: Path, version: Path) -> None:
    wanted = {version / "train" / "main.js"}
    for path in site.rglob("*.js"):
        targets = {(path.parent / target).resolve() for target in IMPORT.findall(path.read_text(encoding="utf-8"))}
        assert all(target.is_file() for target in targets), path
        wanted |= targets
    assert wanted == set(site.rglob("*.js"))


def test_the_passes_are_those_that_run(version: Path) -> None:
    """A host of the smaller description needs nothing else."""
    passes = json.loads((version / "train" / "passes.json").read_text(encoding="utf-8"))
    whole = describe_training(Variant())
    assert set(passes["sequences"]) == set(SEQUENCES)
    assert set(passes["uniforms"]) == {"view", "lens", "update"}
    used = {one["shader"] for sequence in passes["sequences"].values() for one in sequence["passes"]}
    assert set(passes["shaders"]) == used < set(whole.shaders)
    assert set(passes["buffers"]) == set(whole.buffers_of(SEQUENCES)) - {"statistics"}


def test_the_command_writes_it_and_writes_it_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "site"
    for _ in range(2):
        main(["site", str(folder)])
        assert f"kB in {folder}" in capsys.readouterr().out.replace("\n", " ")
    [version] = (path.parent for path in folder.glob("*/train"))
    assert {path.name for path in folder.iterdir()} == {".pocketgs", "index.html", version.name}
    assert {path.name for path in version.iterdir()} == {"train", "page", "gpu"}


def test_other_files_are_kept(tmp_path: Path) -> None:
    folder = tmp_path / "site"
    write_site(folder)
    [train] = folder.glob("*/train")
    (folder / "notes.txt").write_text("mine")
    (train / "mine.js").write_text("mine")
    (folder / "index.html").write_text("changed by hand")
    with pytest.raises(PocketGSError, match="index"):
        write_site(folder)
    assert (folder / "index.html").read_text() == "changed by hand"
    (folder / "index.html").unlink()
    with another_page(tmp_path) as page:
        (page / "added.js").write_text("")
        write_site(folder)
    assert (folder / "notes.txt").read_text() == (train / "mine.js").read_text() == "mine"
    assert [path.name for path in train.parent.rglob("*")] == ["train", "mine.js"]


@pytest.mark.parametrize("version", ["0123456789ab", ""])
def test_what_an_earlier_site_had_goes(tmp_path: Path, version: str) -> None:
    """Also of one from before versions had folders."""
    folder = tmp_path / "site"
    old = Path(version, "train", "prior", "poses", "old.js")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(write, "site_files", lambda: {"index.html": b"old", old.as_posix(): b"old"})
        write_site(folder)
    assert (folder / old).is_file()
    write_site(folder)
    assert not (folder / old.parts[0]).exists()


def test_a_file_of_an_earlier_site_that_was_changed_is_not_deleted(tmp_path: Path) -> None:
    folder = tmp_path / "site"
    write_site(folder)
    [changed] = folder.glob("*/train/main.js")
    changed.write_text("mine")
    with another_page(tmp_path) as page:
        (page / "added.js").write_text("")
        with pytest.raises(PocketGSError, match=r"main.js: has been changed since"):
            write_site(folder)
    assert changed.read_text() == "mine"


def test_a_capture_is_no_place_for_it(capture_folder: Path) -> None:
    with pytest.raises(PocketGSError, match="holds a capture"):
        write_site(capture_folder)
