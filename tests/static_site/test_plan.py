"""The page plans the same buffers as Python, and smaller ones if these do not fit."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Error

from pocketgs.prior.depth.depth_maps import stereo_extent
from pocketgs.prior.depth.depth_range import MOST
from pocketgs.prior.depth.sweep import SweepSettings
from pocketgs.prior.depth.webgpu.passes import describe_sweep
from pocketgs.site.files import NEVER, SEQUENCES
from pocketgs.site.settings import MOST_MEMORY, RECIPE
from pocketgs.splat.webgpu.engine import INTERSECTION_BYTES
from pocketgs.splat.webgpu.memory import MemoryLimits, expected_extent, plan_memory
from pocketgs.splat.webgpu.passes import describe_training
from pocketgs.splat.webgpu.variant import Variant
from pocketgs.training.recipes import RECIPES

Call = Callable[..., Any]

COEFFICIENTS = (RECIPES[RECIPE].sh_degree + 1) ** 2
LARGEST_BUFFER = 1 << 31

PLAN = """
    const {Description} = await import(new URL("../gpu/description.js", location.href));
    const description = new Description(await (await fetch(new URL("passes.json", location.href))).json());
    const {sweep, comparison} = await (await fetch(new URL("depth_passes.json", location.href))).json();
    const depth = {sweep: new Description(sweep), comparison: new Description(comparison)};
    const device = {description, depth, largestBuffer: given.largest};
    const frames = given.sizes.map(([width, height]) => ({width, height, pixelBytes: 4}));
    const outline = {frames, storedPixels: given.stored, hasDepth: given.hasDepth ?? false, videoBytes: 0};
    const {most, gaussians, bytes, screen, prior} = given;
    const wish = {most, gaussians, bytes, screen, prior};
    return module.planRun(outline, wish, device, settings);
"""


def planned(call: Call, **given: Any) -> dict[str, Any]:
    usual = {
        "sizes": [[4000, 3000]] * 40,
        "stored": 12_000_000,
        "most": 800,
        "gaussians": 50_000,
        "bytes": MOST_MEMORY * 1_000_000,
        "largest": LARGEST_BUFFER,
        "screen": {"width": 1, "height": 1},
        "prior": "none",
    }
    return call("training/plan.js", PLAN, {**usual, **given})


def test_buffers_are_those_that_python_plans(call: Call) -> None:
    photographs = [(640, 480), (301, 222), (480, 640)]
    most = LARGEST_BUFFER // INTERSECTION_BYTES[Variant().accumulation]
    whole = describe_training(Variant())
    extent = expected_extent(20_000, COEFFICIENTS, photographs, most)
    sizes = plan_memory(whole, extent, MemoryLimits(1 << 40, LARGEST_BUFFER)).sizes
    expected = sum(sizes[name] for name in whole.part(SEQUENCES, NEVER).buffers)
    plan = planned(call, sizes=[list(size) for size in photographs], stored=640 * 480, gaussians=20_000)
    assert plan["bufferBytes"] == expected
    assert (plan["most"], plan["gaussians"]) == (800, 20_000)
    # Pictures need no buffers of training, but lists of tiles that suffice for half their size.
    drawn = extent.drawn_sizes | {(2560, 1440)}
    longer = expected_extent(20_000, COEFFICIENTS, [*photographs, (1280, 720)], most).intersections
    assert longer > extent.intersections
    larger_extent = replace(extent, drawn_sizes=drawn, intersections=longer)
    sizes = plan_memory(whole, larger_extent, MemoryLimits(1 << 40, LARGEST_BUFFER)).sizes
    expected = sum(sizes[name] for name in whole.part(SEQUENCES, NEVER).buffers)
    screen = {"width": 2560, "height": 1440}
    larger = planned(
        call, sizes=[list(size) for size in photographs], stored=640 * 480, gaussians=20_000, screen=screen
    )
    assert larger["bufferBytes"] == expected > plan["bufferBytes"]
    # Memory for decoding is free again when the buffers are made.
    decoding = planned(call, sizes=[list(size) for size in photographs], stored=60_000_000, gaussians=20_000)
    assert decoding["bytes"] > 960_000_000 > plan["bytes"]
    assert decoding["mostBufferBytes"] == plan["mostBufferBytes"] > 900_000_000
    assert plan["text"].startswith("Takes about ")
    assert "Reduced" not in plan["text"]


def test_photographs_are_reduced_before_splats(call: Call) -> None:
    whole = planned(call)
    assert (whole["most"], whole["gaussians"]) == (800, 50_000)
    many = planned(call, sizes=[[4000, 3000]] * 300)
    assert 320 < many["most"] < 800
    assert many["gaussians"] == 50_000
    assert many["bytes"] <= MOST_MEMORY * 1_000_000
    assert f"Reduced photographs to {many['most']} pixels, because 300 photographs of 800 pixels" in many["text"]
    one_more = planned(call, sizes=[[4000, 3000]] * 300, most=many["most"] + 1)
    assert one_more["most"] == many["most"]
    both = planned(call, sizes=[[4000, 3000]] * 300, gaussians=1_000_000)
    assert both["most"] == 320
    assert 5_000 < both["gaussians"] < 1_000_000
    assert "splats to " in both["text"]
    assert both["bytes"] <= MOST_MEMORY * 1_000_000


def test_what_a_buffer_cannot_hold_is_reduced_too(call: Call) -> None:
    plan = planned(call, gaussians=1_000_000, bytes=16e9, largest=128 << 20)
    assert plan["gaussians"] < 1_000_000
    assert "a buffer larger than the GPU's" in plan["text"]


def test_depth_counts_and_goes_before_a_run_is_refused(call: Call) -> None:
    """The memory of sweeps is that which Python plans."""
    given: dict[str, Any] = {"sizes": [[800, 600]] * 40, "stored": 480_000}
    without, with_depth = planned(call, **given), planned(call, **given, prior="dense")
    settings, passes = SweepSettings(), describe_sweep()
    extent = stereo_extent([(800, 600)] * 40, 40, settings)
    size = {"width": extent.width, "height": extent.height}
    padded = {f"image_{side}": pixels for side, pixels in size.items()}
    others = {"images": 1 + settings.source_views, "hypotheses": MOST, "paths": settings.paths, "bands": 1}
    symbols = passes.symbols({**size, **padded, **others})
    buffers, maps = sum(passes.sizes(symbols, passes.buffers).values()), 8 * 40 * extent.pixels
    assert with_depth["bufferBytes"] == pytest.approx(buffers, rel=0.01)
    assert with_depth["bytes"] == pytest.approx(4 * 40 * 480_000 + buffers + maps, rel=0.01)
    assert (without["bufferBytes"], without["bytes"]) < (buffers, with_depth["bytes"])
    assert with_depth["mostBufferBytes"] == without["mostBufferBytes"]
    smaller = planned(call, **given, prior="dense", bytes=with_depth["bytes"] - 1)
    assert smaller["prior"] == "dense"
    assert smaller["most"] < 800
    assert "40 photographs of 800 pixels and 50,000 splats, with depth, would take" in smaller["text"]
    tight = planned(call, **given, prior="dense", bytes=200e6)
    assert tight["prior"] == "none"
    assert ". Left out depth. Reduced photographs to " in tight["text"]


def test_what_cannot_fit_is_refused(call: Call) -> None:
    with pytest.raises(
        Error, match=r"40 photographs of 320 pixels and 5,000 splats would take [\d,]+ MB, more than 60"
    ):
        planned(call, bytes=60e6)
    with pytest.raises(Error, match=r"would take [\d,]+ MB, more than 1,000 MB"):
        planned(call, stored=100_000_000)


def test_the_outline_is_what_is_loaded(call: Call) -> None:
    """Sizes from headers, with lenses and borders, are those of the photographs once they are decoded."""
    script = """
        const {StoredFile} = await import(new URL("archive/tree.js", location.href));
        const {sourceOf} = await import(new URL("capture/listing.js", location.href));
        const {decodedPhotograph, prepared} = await import(new URL("capture/photograph.js", location.href));
        const canvas = new OffscreenCanvas(90, 60);
        canvas.getContext("2d");
        const bytes = new Uint8Array(await (await canvas.convertToBlob({type: "image/jpeg"})).arrayBuffer());
        const file = new StoredFile("a.jpg", bytes.length, async () => bytes);
        const identity = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
        const camera = {width: 180, height: 120, fx: 160, fy: 160, cx: 91, cy: 59, world_to_camera: identity};
        const lens = (k1) => ({model: "opencv", coefficients: [k1, 0, 0, 0, 0, 0, 0, 0]});
        const depth = {file: new StoredFile("a.npy", given.length, async () => Uint8Array.from(given)), unit: 1};
        const frames = [
            {}, {border: 9}, {lens: lens(0.2)}, {lens: lens(-0.2), border: 3}, {lens: lens(0.2), mask: file, depth},
        ].map((more) => sourceOf(file, camera, more));
        const {frames: found, storedPixels, hasDepth} = await module.outlineOf({frames}, settings.capture);
        const loaded = [];
        for (const source of frames) {
            const pixels = await decodedPhotograph(source, settings.capture);
            const {camera, mask, depth} = await prepared(source, pixels, [0, 0, 0], 1000, settings.capture);
            const bytes = [mask, depth].map((values) => values?.BYTES_PER_ELEMENT ?? 0);
            loaded.push({width: camera.width, height: camera.height, pixelBytes: 4 + bytes[0] + bytes[1]});
        }
        return [found, loaded, storedPixels, hasDepth];
    """
    stream = io.BytesIO()
    np.save(stream, np.ones((30, 45), np.uint16))
    found, loaded, stored, has_depth = call("capture/outline.js", script, list(stream.getvalue()))
    assert found == loaded
    assert stored == 90 * 60
    assert has_depth
    assert len({(size["width"], size["height"]) for size in found}) == 4
