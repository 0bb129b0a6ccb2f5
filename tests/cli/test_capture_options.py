"""What all commands print about a capture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PIL import Image


def test_warnings_and_masks_are_told(pocketgs: Callable, capture_folder: Path, tmp_path: Path) -> None:
    images = sorted((capture_folder / "images").iterdir())
    for image in images[1:4]:
        (capture_folder / "masks").mkdir(exist_ok=True)
        Image.new("L", (48, 36), 255).save(capture_folder / "masks" / f"{image.name}.png")
    images[-1].unlink()
    exported = pocketgs("export-colmap", capture_folder, tmp_path / "colmap")
    assert exported.status == 0
    assert "warning: " in exported.errors
    assert "1 of 8 listed frames have no image file" in exported.errors
    assert "no masks for 4 of 7 frames" in exported.errors
    told = pocketgs("info", capture_folder)
    assert "masks for 3 of 7" in told.output
    assert told.output.count("no masks for 4 of 7 frames") == 1
    assert "masks for" not in pocketgs("info", capture_folder, "--masks", "none").output
    refused = pocketgs("info", capture_folder, "--masks", "nowhere")
    assert (refused.status, "nowhere: no such folder" in refused.errors) == (2, True)
