"""Depth maps and found masks that cannot be used are left out, with Python's warnings; their photographs are used."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pocketgs.capture import Capture
from pocketgs.capture.open import open_capture
from static_site.reading import given_files

Call = Callable[..., Any]

LOAD = """
    const {FileTree, StoredFile} = await import(new URL("archive/tree.js", location.href));
    const bytesOf = (text) => Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
    const files = Object.entries(given).map(([path, text]) => {
        return new StoredFile(path, bytesOf(text).length, async () => bytesOf(text));
    });
    const listing = await module.readListing(new FileTree(files), settings.capture);
    const {train, warnings} = await module.loadCapture(listing, 96, settings, () => {});
    const namesWith = (part) => train.filter(({[part]: found}) => found).map(({name}) => name);
    return [namesWith("depth"), warnings, namesWith("mask")];
"""


def loaded(call: Call, folder: Path) -> tuple[list[str], list[str]]:
    """Names of the frames with depth, and warnings."""
    names, warnings, _ = call("capture/open.js", LOAD, given_files(folder))
    return names, warnings


def test_depth_in_colour_or_cut_short(call: Call, capture_folder: Path) -> None:
    """And of another shape."""
    document = json.loads((capture_folder / "transforms.json").read_text())
    for number, frame in enumerate(document["frames"]):
        size = (48, 48) if number == 3 else (36, 48)
        depth = np.full((*size, 3), 9, np.uint8) if number == 1 else np.full(size, 1500, np.uint16)
        frame["depth_file_path"] = f"depth_{number}.png"
        Image.fromarray(depth).save(capture_folder / frame["depth_file_path"])
    cut = capture_folder / "depth_2.png"
    cut.write_bytes(cut.read_bytes()[:60])
    (capture_folder / "transforms.json").write_text(json.dumps(document))
    names, warnings = loaded(call, capture_folder)
    expected = open_capture(capture_folder)
    assert names == [frame.name for frame in expected.train if frame.depth is not None]
    unreadable, misshapen = warnings
    reason = "(depth_1.png: expected a grey PNG of 8 or 16 bits, not interlaced)"
    assert unreadable == expected.warnings[0].split("(")[0] + reason
    assert misshapen == expected.warnings[1]


def test_masks_cut_short_and_of_another_shape(call: Call, capture_folder: Path) -> None:
    (capture_folder / "masks").mkdir()
    for path in (capture_folder / "images").iterdir():
        Image.new("L", (96, 72), 255).save(capture_folder / "masks" / path.name)
    _, second, third, *_ = sorted((capture_folder / "masks").iterdir())
    second.write_bytes(second.read_bytes()[:60])
    Image.new("L", (72, 96), 255).save(third)
    _, (unreadable, misshapen), names = call("capture/open.js", LOAD, given_files(capture_folder))
    expected = open_capture(capture_folder)
    assert names == [frame.name for frame in expected.train if frame.mask is not None]
    assert unreadable.split("(")[0] == expected.warnings[0].split("(")[0]
    assert misshapen == expected.warnings[1]


def test_damaged_photographs(call: Call, capture_folder: Path) -> None:
    """One without a header, one that ends early; the masks of the others still belong to them."""
    (capture_folder / "masks").mkdir()
    images = sorted((capture_folder / "images").iterdir())
    for path in images:
        Image.new("L", (96, 72), 255).save(capture_folder / "masks" / path.name)
    (capture_folder / "masks" / images[5].name).write_bytes(b"")
    images[2].write_bytes(b"")
    images[4].write_bytes(images[4].read_bytes()[:600])
    outlined = 'const {outlineOf} = await import(new URL("capture/outline.js", location.href));' + LOAD.replace(
        'return [namesWith("depth"), ',
        "return [train.map(({name}) => name), (await outlineOf(listing, settings.capture)).frames.length, ",
    )
    names, count, (found, without_mask), with_mask = call("capture/open.js", outlined, given_files(capture_folder))
    expected = open_capture(capture_folder)
    assert names == [frame.name for frame in expected.train]
    assert count == len(images) - 1
    assert found.split("(")[0] == expected.warnings[0].split("(")[0]
    assert without_mask.split("(")[0] == expected.warnings[1].split("(")[0]
    assert with_mask == [frame.name for frame in expected.train if frame.mask is not None]


def test_confidence_of_another_size(call: Call, copied_phone: Callable[[str], Path]) -> None:
    folder = copied_phone("polycam")
    _, second, *_ = sorted((folder / "keyframes" / "confidence").iterdir())  # the first frame is held out
    Image.new("L", (3, 2), 255).save(second)
    names, warnings = loaded(call, folder)
    expected: Capture = open_capture(folder)
    assert names == [frame.name for frame in expected.train if frame.depth is not None]
    assert warnings == [warning.replace(f"{folder}/", "") for warning in expected.warnings]
