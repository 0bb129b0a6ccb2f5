"""The page's prior on a GPU in software: depth maps, and a whole capture's cloud, as Python has them on the CPU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pocketgs.capture import Capture
from pocketgs.capture.synthetic import true_capture
from pocketgs.prior.depth.cpu.stereo import CpuStereo
from pocketgs.prior.depth.depth_range import DepthRange
from pocketgs.prior.depth.sweep import SweepSettings
from pocketgs.prior.prior import build_prior
from static_site.given import OPEN_DEVICE, TYPED, WITHOUT_FEATURES, plain_cloud, plain_frames

Call = Callable[..., Any]

OPEN = (
    """
    const opening = async () => {
"""
    + OPEN_DEVICE
    + """
        const { Stereo } = await import(new URL("prior/stereo.js", location.href));
        const passes = await (await fetch("depth_passes.json")).json();
        return { device, complaints, stereo: await Stereo.open(device, passes, settings.prior.sweep) };
    };
    const { device, complaints, stereo } = await (self.opened ??= opening());
"""
)
"""Opens the GPU, and what computes depth on it, for the first script; those after it go on with both."""


@pytest.fixture(scope="module")
def capture() -> Capture:
    """With a transparent part and a masked one."""
    capture = true_capture(width=57, height=42, frames=6, points=400)
    first, second, *others = capture.train
    alpha = np.full((42, 57), 255, np.uint8)
    alpha[:, :12] = 0
    masked = replace(second, mask=np.arange(57)[None].repeat(42, 0) > 10)
    return replace(capture, train=[replace(first, alpha=alpha), masked, *others])


@pytest.mark.parametrize("farthest", [6.0, np.inf])
def test_sweeps(call: Call, capture: Capture, farthest: float) -> None:
    search = DepthRange(0.8, farthest, 50)
    script = (
        TYPED
        + OPEN
        + """
        const [keyframe, ...sources] = framesOf(given.frames);
        const search = {...given.search, farthest: given.search.farthest ?? Infinity};
        await stereo.reserve([keyframe.camera], 5);
        const { depth, margin, step } = await stereo.sweep(keyframe, sources, search);
        // A device whose buffers hold half of the sums.
        const limit = Object.getOwnPropertyDescriptor(GPUSupportedLimits.prototype, "maxBufferSize");
        Object.defineProperty(GPUSupportedLimits.prototype, "maxBufferSize", { ...limit, get: () => 400_000 });
        const inBands = await stereo.reserve([keyframe.camera], 5).then(() => stereo.sweep(keyframe, sources, search));
        stereo.mostBytes = 1e6;
        const short = await stereo.reserve([keyframe.camera], 5).catch(({ message }) => message);
        stereo.mostBytes = Infinity;
        const refused = await stereo.reserve([{ width: 400, height: 300 }], 5).catch(({ message }) => message);
        Object.defineProperty(GPUSupportedLimits.prototype, "maxBufferSize", limit);
        const isSame = inBands.depth.every((value, i) => value === depth[i]);
        return [[...depth], [...margin], step, isSame, short, refused, complaints];
    """
    )
    ends = {"nearest": 0.8, "hypotheses": 50} | ({"farthest": farthest} if np.isfinite(farthest) else {})
    given = {"frames": plain_frames(capture.train[:5]), "search": ends}
    depth, margin, step, is_same, short, refused, complaints = call("prior/stereo.js", script, given)
    expected = CpuStereo().sweep(capture.train[0], capture.train[1:5], search, SweepSettings())
    assert complaints == []
    assert is_same
    assert short == "it would take 2 MB, of which 1 MB are left"
    assert "the device allows 0 MB" in refused
    assert step == pytest.approx(expected.step, rel=1e-5)
    found = np.reshape(depth, expected.depth.shape)
    np.testing.assert_array_equal(found > 0, expected.depth > 0)
    known = found > 0
    close = np.abs(1 / found[known] - 1 / expected.depth[known]) < 0.1 * step
    assert np.mean(close) > 0.99
    assert np.mean(np.abs(np.reshape(margin, found.shape) - expected.margin) < 1e-3) > 0.99


@pytest.mark.parametrize(("has_cloud", "has_depth"), [(True, False), (False, False), (False, True)])
def test_clouds(call: Call, capture: Capture, has_cloud: bool, has_depth: bool) -> None:
    capture = replace(capture, train=capture.train[:4], points=capture.points if has_cloud else None)
    if not has_depth:
        capture = replace(capture, train=[replace(frame, depth=None) for frame in capture.train])
    script = (
        TYPED
        + OPEN
        + """
        const own = given.cloud ? cloudOf(given.cloud) : null;
        const stages = [];
        const listener = { onStage: async (text) => stages.push(text) };
        const loaded = { train: framesOf(given.frames), heldOut: [], cloud: own };
        const options = { most: 1500, refines: false };
        const { dense } = await module.buildPrior(loaded, options, settings, { stereo }, listener);
        const { cloud, covered, keyframes } = dense;
        return [[...cloud.positions], [...cloud.colours], covered, keyframes, stages, complaints];
    """
    )
    cloud = plain_cloud(capture.points) if capture.points else None
    given = {"frames": plain_frames(capture.train), "cloud": cloud}
    positions, colours, covered, keyframes, stages, complaints = call("prior/prior.js", script, given)
    expected = build_prior(replace(capture, metric=False), 1500, WITHOUT_FEATURES)
    assert complaints == []
    assert expected.report is not None
    assert expected.points is not None
    assert keyframes == sum(decision.kept for decision in expected.report.decisions)
    assert f"depth of keyframe {keyframes} of {keyframes}" in stages
    assert covered == pytest.approx(expected.report.coverage, abs=0.01)
    found = np.reshape(positions, (-1, 3))
    assert abs(len(found) - len(expected.points)) <= 30
    # With one pixel more or less, by rounding, all voxels have another size: points are the same within their spacing.
    away, nearest = cKDTree(expected.points.positions).query(found)
    spacing, _ = cKDTree(expected.points.positions).query(expected.points.positions, k=2)
    assert np.quantile(away, 0.95) < 1.5 * np.median(spacing[:, 1])
    off = np.abs(np.reshape(colours, (-1, 3)) - expected.points.colours[nearest])
    assert np.median(off) < 0.02


def test_pixels_without_depth_take_no_place_from_others(call: Call, capture: Capture) -> None:
    script = (
        TYPED
        + """
        const [keyframe] = framesOf(given.frames);
        const { camera } = keyframe;
        const depth = new Float32Array(camera.width * camera.height).map((_, i) => i % 2);
        const stereo = { async *compare() { yield { confidences: depth, footprints: depth }; } };
        const counts = [];
        for (const share of [2, 4]) {
            const limited = { ...settings.prior.fusion, max_candidates: depth.length / share };
            const views = [{ camera, map: { depth, step: 1e-5 } }];
            counts.push((await module.fuse([keyframe], views, [keyframe], limited, stereo)).count);
        }
        return [depth.length, ...counts];
    """
    )
    pixels, *counts = call("prior/fuse.js", script, {"frames": plain_frames(capture.train[2:3])})
    assert counts == [pixels // 2, -(-pixels // 4)]


def test_candidates_are_dropped_whole(call: Call) -> None:
    script = """
        const some = new module.Candidates(5);
        [0, 1, 2, 3].forEach((i) => some.add([i, i, i], [i, i, i], [i, i, i], i, i, i));
        some.drop(Uint8Array.of(1, 0, 1, 0));
        const rows = [some.positions, some.colours, some.directions].map((all) => [...all.subarray(0, 6)]);
        const values = [some.footprints, some.details, some.confidences].map((all) => [...all.subarray(0, 2)]);
        return [some.count, rows, values];
    """
    assert call("prior/candidates.js", script, None) == [2, [[1, 1, 1, 3, 3, 3]] * 3, [[1, 3]] * 3]


def test_training_starts_from_other_points_once_memory_is_full(call: Call, capture: Capture) -> None:
    """Whatever finds it full, and what is cancelled, gives the GPU's memory back."""
    script = (
        TYPED
        + OPEN
        + """
        const outcome = async ([begun, hasCloud, isCancelled]) => {
            const warnings = [];
            const onStage = async (text) => {
                if (text.startsWith(begun) && isCancelled) {
                    throw new DOMException("", "AbortError");
                }
                if (text.startsWith(begun)) {
                    device.popErrorScope = async () => new GPUOutOfMemoryError("");
                }
            };
            const listener = { onStage, onWarning: (text) => warnings.push(text) };
            const loaded = { train: framesOf(given.frames), heldOut: [], cloud: hasCloud && cloudOf(given.cloud) };
            const options = { gaussians: 400, seed: 0, prior: "dense", refines: false };
            const preparing = module.prepared(loaded, options, settings, { stereo }, listener);
            const found = await preparing.then(({ points }) => points.positions.length / 3, ({ name }) => name);
            delete device.popErrorScope;
            return [found, ...warnings, stereo.bytes];
        };
        const outcomes = [];
        for (const one of given.cases) {
            outcomes.push(await outcome(one));
        }
        return outcomes;
    """
    )
    assert capture.points is not None
    cases = {
        ("rough depth of photograph 2", False, True): ["AbortError", 0],
        ("rough depth of photograph 1", False): [400, told("points where the photographs agree"), 0],
        ("choosing keyframes", True): [400, told("the capture's own points"), 0],
        ("depth of keyframe 2", True): [400, told("the capture's own points"), 0],
        ("comparing depth maps", True): [400, told("the capture's own points"), 0],
    }
    frames = plain_frames(capture.train[:3])
    given = {"frames": frames, "cloud": plain_cloud(capture.points), "cases": list(cases)}
    assert call("training/preparation.js", script, given) == list(cases.values())


def told(instead: str) -> str:
    full = "the GPU's memory is full: expected a smaller scene or smaller images"
    return f"Depth is not computed: {full}. Training starts from {instead}."
