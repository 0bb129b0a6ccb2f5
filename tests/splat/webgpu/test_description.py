"""The passes as data: uniform layouts, shaders within WebGPU's limits, and no name that nobody knows."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import pocketgs
from pocketgs.gpu.description import Description, Pass
from pocketgs.gpu.sizes import ceil_div, evaluate
from pocketgs.prior.bundle.webgpu.passes import SHADERS as BUNDLE_SHADERS
from pocketgs.prior.cloud.webgpu.passes import SHADERS as CLOUD_SHADERS
from pocketgs.prior.depth.webgpu.passes import SHADERS as DEPTH_SHADERS
from pocketgs.prior.features.webgpu.passes import SHADERS as FEATURE_SHADERS
from pocketgs.seeding.webgpu.passes import SHADERS as SEED_SHADERS
from pocketgs.splat.webgpu.lenses import LENSES
from pocketgs.splat.webgpu.passes import describe_rendering, describe_training
from pocketgs.splat.webgpu.rasterizer_passes import describe_rasterizer
from pocketgs.splat.webgpu.shader_files import SHADERS
from pocketgs.splat.webgpu.variant import Variant
from splat.webgpu.every_description import DESCRIPTIONS
from splat.webgpu.wgsl_layout import constant, workgroup_bytes, workgroup_size

LIBRARIES = (SHADERS, BUNDLE_SHADERS, CLOUD_SHADERS, DEPTH_SHADERS, FEATURE_SHADERS, SEED_SHADERS)

CASE = {
    "gaussians": 1000,
    "capacity": 1000,
    "coefficients": 4,
    "view_coefficients": 4,
    "width": 650,
    "height": 480,
    "intersections": 65_536,
    "photograph_pixels": 312_000,
    "replay_depth": 24,
    "structural": 1,
    "regularised": 0,
    "collecting": 1,
    "photographs": 1,
    "listed": 300,
    "drawn_tiles": 70,
    "channel_groups": 5,
    "colours": 1,
    "antialiased": 1,
    **dict.fromkeys(LENSES, 1),
    "image_width": 700,
    "image_height": 480,
    "images": 5,
    "hypotheses": 192,
    "paths": 8,
    "bands": 4,
    "views": 20,
    "chosen": 2000,
    "first": 2000,
    "second": 1900,
    "points": 5000,
    "leaves": 1024,
    "cameras": 30,
    "candidates": 40_000,
    "levels": 12,
    "voxels": 9000,
    "observations": 25_000,
    "pairs": 435,
    "meetings": 60_000,
}


@pytest.fixture(params=DESCRIPTIONS)
def description(request: pytest.FixtureRequest) -> Description:
    return DESCRIPTIONS[request.param]


def passes_of(description: Description) -> list[Pass]:
    return [one for sequence in description.sequences.values() for one in sequence.passes]


def bound(description: Description, one: Pass) -> list[tuple[str, str]]:
    """Buffer and access of each of a pass's bindings."""
    bindings = description.shaders[one.shader].bindings
    return [(one.buffers.get(binding.name, binding.name), binding.access) for binding in bindings]


def test_uniforms_lie_where_the_shaders_read_them() -> None:
    view, update = (describe_training(Variant()).uniforms[name] for name in ("view", "update"))
    vectors = ["to_camera_x", "to_camera_y", "to_camera_z", "centre", "background"]
    assert [view.fields[name] for name in vectors] == [("vec4f", 16 * i) for i in range(5)]
    pairs = ["focal", "principal", "slopes_low", "slopes_high"]
    assert [view.fields[name] for name in pairs] == [("vec2f", 80 + 8 * i) for i in range(4)]
    assert view.fields["width"] == ("u32", 112)
    assert view.fields["height"] == ("u32", 116)
    offsets = [offset for kind, offset in view.fields.values() if kind == "u32"]
    assert offsets == list(range(112, 112 + 4 * len(offsets), 4))
    assert view.size == 16 * ceil_div(112 + 4 * len(offsets), 16)
    assert [offset for _, offset in update.fields.values()] == list(range(0, update.size, 4))


def test_shaders_keep_to_the_limits_of_every_device(description: Description) -> None:
    for name, shader in description.shaders.items():
        numbers = [int(number) for number in re.findall(r"@binding\((\d+)\)", shader.source)]
        assert sorted(numbers) == list(range(len(shader.bindings))), name
        storage = [binding for binding in shader.bindings if binding.access != "uniform"]
        assert len(storage) <= 8, name
        assert workgroup_bytes(shader.source) <= 16_384, name
        assert workgroup_size(shader.source) <= 256, name
        assert "import " not in re.sub(r"//.*", "", shader.source), name


def test_every_name_in_a_pass_is_known(description: Description) -> None:
    for one in passes_of(description):
        shader = description.shaders[one.shader]
        bindings = {binding.name: binding.access for binding in shader.bindings}
        assert one.buffers.keys() <= bindings.keys(), one.name
        assert one.constants.keys() <= set(re.findall(r"^override (\w+)", shader.source, re.MULTILINE)), one.name
        for buffer, access in bound(description, one):
            assert buffer in (description.uniforms if access == "uniform" else description.buffers), one.name
        assert (one.groups is None) != (one.indirect is None), one.name
        if one.indirect:
            buffer, offset = one.indirect
            assert evaluate(description.buffers[buffer], {}) >= offset + 12, one.name
    for sequence in description.sequences.values():
        assert set(sequence.cleared) <= description.buffers.keys()


def test_no_pass_writes_what_it_also_reads_by_another_name(description: Description) -> None:
    """WebGPU forbids it, dispatches that a buffer sizes included."""
    for one in passes_of(description):
        names = [name for name, _ in bound(description, one)]
        written = [name for name, access in bound(description, one) if access == "read_write"]
        assert all(names.count(name) == 1 for name in written), one.name
        assert not one.indirect or one.indirect[0] not in written, one.name


def test_every_expression_has_a_value(description: Description) -> None:
    symbols = description.symbols(CASE)
    for one in passes_of(description):
        assert evaluate(one.when, symbols) in (0, 1)
        assert one.groups is None or evaluate(one.groups, symbols) >= 1
    assert all(size > 0 for size in description.sizes(symbols, description.buffers).values())


def test_every_buffer_is_bound_by_some_pass(description: Description) -> None:
    assert set(description.buffers_of(description.sequences)) == set(description.buffers)


def test_rendering_needs_fewer_buffers_than_training() -> None:
    description = describe_training(Variant())
    assert "photographs" not in description.buffers_of(["render", "render depth"])
    assert {"image", "splats", "tile_starts", "shape", "sh", "status"} <= set(description.buffers_of(["render"]))


def test_every_shader_file_is_of_use() -> None:
    texts = [shader.source for description in DESCRIPTIONS.values() for shader in description.shaders.values()]
    named = {name for description in DESCRIPTIONS.values() for name in description.shaders}
    for path in Path(pocketgs.__file__).parent.rglob("shaders/*.wgsl"):
        assert path.stem in named, path
    for name, section in (each for library in LIBRARIES for each in library.sections.items()):
        lines = [line for line in section.splitlines() if not line.startswith(("import ", "enable "))]
        assert any("\n".join(lines) in text for text in texts), name


@pytest.mark.parametrize("tiles", [1, 2, 255, 256, 257, 65_535, 65_536, 70_000])
def test_the_sort_by_tile_takes_as_many_digits_as_tiles_have(tiles: int) -> None:
    """And an even number of them, so that the result is not left in the spare buffers."""
    description = describe_training(Variant())
    symbols = description.symbols({**CASE, "width": 8 * tiles, "height": 8})
    assert symbols["tiles"] == tiles
    moves = [
        one
        for one in description.sequences["step"].passes
        if one.shader == "radix_scatter" and "tile_keys" in one.buffers.values() and evaluate(one.when, symbols)
    ]
    assert len(moves) % 2 == 0
    # The number after the last tile's stands for none.
    assert tiles < 1 << 4 * len(moves)
    targets = [one.buffers["sorted_keys"] for one in moves]
    assert targets[-1] == "tile_keys"
    assert all(one.buffers["keys"] == target for one, target in zip(moves[1:], targets[:-1], strict=True))


def test_a_description_survives_json(description: Description) -> None:
    document = description.to_json()
    restored = json.loads(json.dumps(document))
    assert restored == document
    assert restored["sequences"].keys() == description.sequences.keys()
    for name, sequence in description.sequences.items():
        found = restored["sequences"][name]["passes"]
        assert [one["name"] for one in found] == [one.name for one in sequence.passes]
        assert [one["constants"] for one in found] == [dict(one.constants) for one in sequence.passes]
    for name, shader in description.shaders.items():
        assert restored["shaders"][name]["source"].endswith(shader.source)
        assert [one["name"] for one in restored["shaders"][name]["bindings"]] == [one.name for one in shader.bindings]
    for name, uniform in restored["uniforms"].items():
        for field, place in uniform["fields"].items():
            assert tuple(place.values()) == description.uniforms[name].fields[field]


def test_sizes_are_those_worked_out_by_hand() -> None:
    """1,000 Gaussians of SH degree 1 and room for 65,536 intersections, at 650 x 480: 82 x 60 tiles."""
    description = describe_training(Variant("f32", "cache"))
    sizes = description.sizes(description.symbols(CASE), description.buffers)
    half = describe_training(Variant("f16", "cache", "atomic"))
    pixels, tiles, patches, intersections = 312_000, 4_920, 1_230, 65_536
    by_gaussian = {"shape": 44, "sh": 48, "splats": 40, "depth_keys": 4, "order": 4, "tile_counts": 4}
    by_gaussian |= {"depth_keys_spare": 4, "order_spare": 4}
    by_gaussian |= dict.fromkeys(("gradients", "first_moments", "second_moments"), 88)
    expected = {name: 1000 * size for name, size in by_gaussian.items()}
    expected |= {"statistics": 16_000, "row_sources": 4_000}
    expected |= {
        name: 4 * intersections for name in ("tile_keys", "tile_keys_spare", "slots", "slots_spare", "slot_splats")
    }
    expected |= {
        "gradient_rows": 36 * intersections,
        "first_slots": 4_004,
        "block_sums": 16,
        "digit_counts": 16 * 4 * 32,
        "depth_digit": 16,
        "tile_digit": 16,
        "gaussian_count": 16,
        "cluster_bounds": 32 * 4,
        "cluster_places": 16,
        "intersection_count": 16,
        "intersection_dispatches": 24,
        "status": 16,
        "tile_starts": 4 * tiles + 8,
        "drawn_ranges": 8 * tiles,
        "image": 16 * pixels,
        "d_image": 16 * pixels,
        "ssim_derivatives": 36 * pixels,
        "photographs": 4 * pixels,
        "replay_cache": pixels * (4 + 24 * 20),
        "loss_parts": 8 * patches,
        "colours": 4 * 37,
        "colour_parts": 48 * patches,
        "regulariser_parts": 16,
        "losses": 4 * 4096,
    }
    assert sizes == expected
    in_half = half.sizes(half.symbols(CASE), half.buffers)
    different = {"splats": 28_000, "replay_cache": pixels * (4 + 24 * 12), "gradient_rows": 36_000}
    assert in_half == {**expected, **different}


def test_words_of_the_shaders_are_the_bytes_of_the_buffers() -> None:
    """Sizes of a splat, a record of the replay cache and a row of sums."""
    for precision in ("f32", "f16"):
        for replay in ("recompute", "cache"):
            description = describe_training(Variant(precision, replay))  # type: ignore[arg-type]
            symbols = {"capacity": 1, "intersections": 1, "pixels": 1, "replay_depth": 1}
            backward = description.shaders["rasterize_backward"].source
            splat = 4 * constant("SPLAT_WORDS", backward)
            assert evaluate(description.buffers["splats"], symbols) == splat
            assert evaluate(description.buffers["gradient_rows"], symbols) == 4 * constant("SUM_WORDS", backward)
            if replay == "cache":
                record = 4 * constant("RECORD_WORDS", backward)
                assert evaluate(description.buffers["replay_cache"], symbols) == 4 + record
    weighted = describe_rendering(Variant(weights="lc"))
    splat = 4 * constant("SPLAT_WORDS", weighted.shaders["rasterize"].source)
    assert evaluate(weighted.buffers["splats"], {"capacity": 1}) == splat


def test_rows_of_channels_are_as_long_in_the_shaders_as_in_the_buffers() -> None:
    description = describe_rasterizer(False)
    symbols = {**CASE, "capacity": 1, "intersections": 1}
    backward = description.shaders["rasterize_channels_backward"].source
    words = constant("SHAPE_WORDS", backward) + 3 * CASE["channel_groups"]
    assert evaluate(description.buffers["gradient_rows"], symbols) == 4 * words
    words = constant("CENTRE_WORDS", description.shaders["gather_channels"].source) + 3 * CASE["channel_groups"]
    assert evaluate(description.buffers["channel_gradients"], symbols) == 4 * words
