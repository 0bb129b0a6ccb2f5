"""Reading one capture by the page and by Python."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Error

from pocketgs.capture.decoding.video_file import VideoFrame
from pocketgs.capture.hold_out import choose_held_out
from pocketgs.capture.masks import with_masks
from pocketgs.capture.open import read_listing
from pocketgs.errors import PocketGSError

Call = Callable[..., Any]

READ = """
    const {FileTree, StoredFile} = await import(new URL("archive/tree.js", location.href));
    const {heldOutOf} = await import(new URL("capture/listing.js", location.href));
    const bytesOf = (text) => Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
    const files = Object.entries(given).map(([path, text]) => {
        return new StoredFile(path, bytesOf(text).length, async () => bytesOf(text));
    });
    const listing = await module.readListing(new FileTree(files), settings.capture);
    return {
        format: listing.format,
        frames: listing.frames.map(({mask, depth, ...frame}) => ({
            ...frame,
            mask: mask?.path ?? null,
            depth: depth && [depth.file.path, depth.unit, depth.confidence?.path ?? null, depth.size],
        })),
        heldOut: [...heldOutOf(listing, settings.run)].sort(),
        cloud: listing.cloud && [[...listing.cloud.positions], [...listing.cloud.colours]],
        background: listing.background,
        warnings: listing.warnings,
    };
"""


def given_files(folder: Path) -> dict[str, str]:
    """The files of a capture as text, by their paths in it."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): base64.b64encode(path.read_bytes()).decode() for path in files}


def read(call: Call, folder: Path) -> dict[str, Any]:
    return call("capture/open.js", READ, given_files(folder))


def assert_same(call: Call, folder: Path) -> None:
    """With what both find, masks and depth included."""
    found, expected = read(call, folder), with_masks(read_listing(folder), folder, "found")
    assert found["format"] == expected.format
    assert [frame["name"] for frame in found["frames"]] == [frame.name for frame in expected.frames]
    for one, other in zip(found["frames"], expected.frames, strict=True):
        camera = other.camera
        numbers = [one["camera"][name] for name in ("width", "height", "fx", "fy", "cx", "cy")]
        assert numbers == pytest.approx([camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy])
        pose = np.reshape(one["camera"]["world_to_camera"], (4, 4))
        np.testing.assert_allclose(pose, camera.world_to_camera, rtol=0, atol=1e-9)
        assert one["lens"]["model"] == other.lens.model
        coefficients = [*other.lens.coefficients, *[0.0] * 8][: len(one["lens"]["coefficients"])]
        assert one["lens"]["coefficients"] == coefficients
        assert one["border"] == other.border
        assert one["frame"] == (other.image.index if isinstance(other.image, VideoFrame) else None)
        paths = [
            path and Path(str(path)).relative_to(folder).as_posix()
            for path in (other.mask_path, other.depth_path, other.confidence_path)
        ]
        assert one["mask"] == paths[0]
        size = None if other.depth_shape is None else list(other.depth_shape)[::-1]
        assert one["depth"] == (None if paths[1] is None else [paths[1], other.depth_unit, paths[2], size])
    assert found["heldOut"] == sorted(choose_held_out(expected, 8)[0])
    assert found["background"] == list(expected.background)
    assert len(found["warnings"]) == len(expected.warnings)
    assert (found["cloud"] is None) == (expected.points is None)
    if expected.points is not None:
        positions, colours = (np.reshape(values, (-1, 3)) for values in found["cloud"])
        np.testing.assert_array_equal(positions, expected.points.positions)
        np.testing.assert_allclose(colours, expected.points.colours, rtol=0, atol=1e-7)


def assert_same_warnings(call: Call, folder: Path) -> None:
    """And everything else too."""
    assert_same(call, folder)
    assert read(call, folder)["warnings"] == [text.replace(f"{folder}/", "") for text in read_listing(folder).warnings]


def assert_same_refusal(call: Call, folder: Path, words: str) -> None:
    """Both refuse the capture by these words, a regular expression."""
    with pytest.raises(PocketGSError, match=words):
        read_listing(folder)
    with pytest.raises(Error, match=words):
        read(call, folder)
