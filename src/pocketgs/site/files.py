"""The files of the site: the page, the modules that it shares with the viewer, the passes, and the settings."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import pocketgs.gpu
import pocketgs.viewer
from pocketgs.gpu.description import Description
from pocketgs.prior.depth.webgpu.passes import describe_comparison, describe_sweep
from pocketgs.prior.features.webgpu.passes import describe_features, describe_matching
from pocketgs.seeding.webgpu.passes import describe_neighbourhoods
from pocketgs.site.settings import settings
from pocketgs.splat.webgpu.passes import describe_training
from pocketgs.splat.webgpu.variant import Variant
from pocketgs.viewer.constants import MODULE, constants_module

PAGE = Path(__file__).parent / "page"
VIEWER = Path(pocketgs.viewer.__file__).parent / "page"
EXECUTOR = Path(pocketgs.gpu.__file__).parent

SHARED = (
    "controls/dropping.js",
    "controls/leaving.js",
    "controls/pointer.js",
    "controls/saving.js",
    "drawing/frame_loop.js",
    "drawing/opening.js",
    "drawing/view_values.js",
    "element.js",
    "formats/bits.js",
    "formats/crc32.js",
    "formats/opacity.js",
    "formats/pgs_attributes.js",
    "formats/pgs_positions.js",
    "formats/pgs_rotations.js",
    "formats/pgs_sections.js",
    "formats/ply_columns.js",
    "formats/ply_header.js",
    "formats/range_decoder.js",
    "formats/range_models.js",
    "formats/spz_attributes.js",
    "icon.svg",
    "live/curves.js",
    "live/figures.js",
    "live/stage.js",
    "scene/camera.js",
    "scene/gaussian_columns.js",
    "scene/near_plane.js",
    "scene/vectors.js",
    "styles/live.css",
    "styles/messages.css",
    "styles/style.css",
)
"""Of the viewer's files, those that the page uses."""

SEQUENCES = ("render", "step")
NEVER = ("collect statistics", "regularise")
"""Passes that no step of the page's recipe has."""

COMMENT, LINE_BREAK, SPACED = re.compile("//[^\n]*"), re.compile(r"\s*\n\s*"), re.compile(" ?([,;:(){}+*]) ?")
"""In WGSL, which has no strings that could contain them."""

HTML = "index.html"

VERSION = b"{version}"
"""In the page, stands for the folder of everything else."""


def site_files() -> dict[str, bytes]:
    """The content of every file, by its path in the site.

    All but the page itself are below a folder that is named by what the site consists of. Hosts that say nothing about
    caching let browsers use files for days without asking: so a new page never runs an earlier one's modules.
    """
    files = _unversioned()
    version = _version(files)
    page = files.pop(HTML).replace(VERSION, version.encode())
    return {HTML: page} | {f"{version}/{name}": content for name, content in files.items()}


def _version(files: dict[str, bytes]) -> str:
    digest = hashlib.sha256()
    for name, content in sorted(files.items()):
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()[:12]


def _unversioned() -> dict[str, bytes]:
    files = {f"page/{name}": (VIEWER / name).read_bytes() for name in SHARED}
    files[f"page/{MODULE}"] = constants_module().encode()
    files |= {f"gpu/{path.name}": path.read_bytes() for path in sorted(EXECUTOR.glob("*.js"))}
    own = [path for path in sorted(PAGE.rglob("*")) if path.is_file()]
    files |= {f"train/{path.relative_to(PAGE).as_posix()}": path.read_bytes() for path in own}
    files[HTML] = files.pop(f"train/{HTML}")
    files["train/passes.json"] = _encoded(_plain(describe_training(Variant()).part(SEQUENCES, NEVER)))
    depth = {"sweep": _plain(describe_sweep()), "comparison": _plain(describe_comparison())}
    files["train/depth_passes.json"] = _encoded(depth)
    features = {"finding": _plain(describe_features()), "matching": _plain(describe_matching())}
    files["train/features_passes.json"] = _encoded(features)
    files["train/seeding_passes.json"] = _encoded(_plain(describe_neighbourhoods()))
    files["train/settings.json"] = _encoded(settings())
    return files


def _plain(description: Description) -> dict[str, Any]:
    """A description for JSON; its shaders are without comments, indentation and spaces, which only cost bytes."""
    found = description.to_json()
    for shader in found["shaders"].values():
        shader["source"] = SPACED.sub(r"\1", LINE_BREAK.sub("\n", COMMENT.sub("", shader["source"])))
    return found


def _encoded(content: object) -> bytes:
    return json.dumps(content, separators=(",", ":")).encode()
