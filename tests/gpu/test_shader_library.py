"""Linking of shaders: files, sections, variants, constants, and errors."""

from __future__ import annotations

from pathlib import Path

import pytest

from pocketgs.gpu.shader_library import Binding, ShaderLibrary

SHADES = """// Colours.
const WHITE: f32 = 1.0;

section dark
enable subgroups;
import numbers
fn shade() -> f32 { return ONE; }

section light
fn shade() -> f32 { return WHITE; }
"""
PAINT = """import shades.kind, workgroups
@group(0) @binding(1) var<storage, read_write> out: array<f32>;
@group(0) @binding(0) var<uniform> size: Size;
fn main() { out[0] = shade() * SHARE * WEIGHTS[COUNT] + f32(THREADS); }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "common").mkdir()
    (tmp_path / "common" / "shades.wgsl").write_text(SHADES)
    (tmp_path / "common" / "numbers.wgsl").write_text("const ONE: f32 = 1.0;\n")
    (tmp_path / "paint.wgsl").write_text(PAINT)
    return tmp_path


def test_variants_choose_sections(folder: Path) -> None:
    library = ShaderLibrary(folder, {})
    dark, light = (library.link("paint", {"shades.kind": f"shades.{name}"}) for name in ("dark", "light"))
    assert "return ONE" in dark.source
    assert "const ONE" in dark.source
    assert "return WHITE" not in dark.source
    assert "return WHITE" in light.source
    assert "const ONE" not in light.source
    for shader in (dark, light):
        assert shader.source.count("const WHITE") == 1, "what comes before the sections comes with each of them"
        assert "fn folded" in shader.source
        assert "import " not in shader.source
        assert "section " not in shader.source
        assert shader.bindings == (Binding("size", "uniform"), Binding("out", "read_write"))
    assert (dark.extensions, light.extensions) == (("subgroups",), ())
    assert "enable" not in dark.source


def test_constants_are_written_out_where_they_are_used(folder: Path) -> None:
    constants = {"COUNT": 3, "SHARE": 0.1, "WEIGHTS": [0.25, 0.5], "UNUSED": 4}
    source = ShaderLibrary(folder, constants).link("paint", {"shades.kind": "shades.light"}).source
    for line in (
        "const THREADS: u32 = 256u;",
        "const COUNT: u32 = 3u;",
        "const SHARE: f32 = 0.1;",
        "const WEIGHTS: array<f32, 2> = array<f32, 2>(0.25, 0.5);",
    ):
        assert f"{line}\n" in source
    assert "UNUSED" not in source


def test_what_is_missing_is_named(folder: Path) -> None:
    library = ShaderLibrary(folder, {})
    with pytest.raises(ValueError, match=r"shader 'spray': not found, expected one of .*paint"):
        library.link("spray", {})
    with pytest.raises(ValueError, match=r"import shades\.kind: not found, expected one of .*shades\.dark"):
        library.link("paint", {})
    (folder / "paint.wgsl").write_text(PAINT.replace("binding(1)", "binding(2)"))
    with pytest.raises(ValueError, match=r"found bindings \[0, 2\]"):
        ShaderLibrary(folder, {}).link("paint", {"shades.kind": "shades.dark"})
