"""The page's features on a GPU in software, as Python has them on the CPU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pocketgs.capture.synthetic import true_capture
from pocketgs.prior.features.cpu.finder import CpuFinder
from pocketgs.prior.poses.structure import StructureSettings, build_structure
from pocketgs.prior.scale import estimate_scale
from static_site.given import OPEN_FINDER, TYPED, plain_frames
from static_site.test_poses import astray, turned

Call = Callable[..., Any]


def test_features_and_matches(call: Call) -> None:
    """A transparent photograph, a masked one, and one that is larger than the memory allows."""
    capture = true_capture(width=120, height=90, frames=4, points=1)
    first, second, third = capture.train[:3]
    alpha, mask = np.full((90, 120), 255, np.uint8), np.ones((90, 120), bool)
    alpha[:30] = 0
    mask[:, 90:] = False
    frames = [replace(first, alpha=alpha), replace(second, mask=mask), third]
    script = (
        TYPED
        + OPEN_FINDER
        + """
        const frames = framesOf(given);
        const stages = [];
        const found = await finder.detect(frames, async (done) => stages.push(done));
        const matches = await finder.match(0, 1);
        const words = await finder.words(64, async (done) => stages.push(`words ${done}`));
        const isFreed = finder.bytes > 0;
        finder.release();
        const { other_bytes, pixel_bytes, descriptor, most } = settings.prior.features;
        finder.mostBytes = other_bytes + 3000 * pixel_bytes + 4 * descriptor * most;
        const hasRoom = finder.hasRoomFor(1);
        const [reduced] = await finder.detect(frames.slice(2), async () => {});
        finder.release();
        const bytes = finder.bytes;
        device.destroy();
        const plain = ({ pixels, count, grain }) => ({ pixels: [...pixels], count, grain });
        const all = [[...found, reduced].map(plain), [...matches], words.map((own) => [...own])];
        return [...all, stages, isFreed, hasRoom, bytes, complaints];
    """
    )
    found, matches, words, stages, is_freed, has_room, released, complaints = call(
        "prior/features/finder.js", script, plain_frames(frames)
    )
    assert complaints == []
    assert stages == [0, 1, 2, "words 0", "words 1", "words 2"]
    assert [len(own) for own in words] == [one["count"] for one in found[:3]]
    drawn = [word for own in words for word in own]
    # Each of the 64 features that are words is its own nearest word.
    assert sorted(set(drawn)) == list(range(64))
    assert is_freed
    assert not has_room
    assert released == 0
    finder = CpuFinder()
    expected = [finder.detect(frame, 2000) for frame in frames]
    positions = [np.reshape(one["pixels"], (-1, 2)) for one in found]
    for pixels, features, one in zip(positions, expected, found, strict=False):
        assert one["grain"] == 1
        assert one["count"] == len(pixels)
        assert abs(len(pixels) - len(features.pixels)) <= 0.02 * len(features.pixels)
        assert np.mean(cKDTree(pixels).query(features.pixels)[0] < 0.01) > 0.98
    pairs, theirs = np.reshape(matches, (-1, 2)), finder.match(expected[0], expected[1])
    assert abs(len(pairs) - len(theirs)) <= 0.03 * len(theirs)
    joined, others = (
        np.concatenate([one[chosen[:, 0]], other[chosen[:, 1]]], axis=1)
        for one, other, chosen in (
            (*positions[:2], pairs),
            (expected[0].pixels, expected[1].pixels, theirs),
        )
    )
    assert np.mean(cKDTree(joined).query(others)[0] < 0.02) > 0.97
    # Of an image of 3,000 pixels, in the pixels of the frame.
    assert found[3]["grain"] == pytest.approx(np.sqrt(120 * 90 / 3000), rel=0.03)
    near = cKDTree(expected[2].pixels).query(positions[3])[0]
    assert np.mean(near < 1) > 0.5


def test_structure(call: Call) -> None:
    """Points and refined poses of views that are off by a quarter of a degree, from the page's own features."""
    capture, rng = true_capture(width=128, height=96, frames=6, points=1), np.random.default_rng(0)
    scale = estimate_scale(capture)
    frames = [replace(frame, camera=astray(frame.camera, rng, scale)) for frame in capture.train]
    script = (
        TYPED
        + OPEN_FINDER
        + """
        const stages = [];
        const onStage = async (text) => stages.push(text);
        const found = await module.buildStructure(framesOf(given.frames), given.scale, settings.prior, finder, onStage);
        const two = framesOf(given.frames.slice(0, 2));
        const blank = two.map((frame) => ({ ...frame, rgba: frame.rgba.map(() => 200) }));
        const nothing = await module.buildStructure(blank, given.scale, settings.prior, finder, onStage);
        device.destroy();
        return [found.cameras.map(({ world_to_camera: m }) => m), found.points.length / 3, nothing, stages, complaints];
    """
    )
    given = {"frames": plain_frames(frames), "scale": {"distance": scale.distance, "unit": scale.unit}}
    poses, points, nothing, stages, complaints = call("prior/poses/structure.js", script, given)
    expected = build_structure(frames, scale, StructureSettings())
    assert complaints == []
    assert nothing is None
    assert stages[0] == f"features of photograph 1 of {len(frames)}"
    assert "adjusting poses" in stages
    assert expected is not None
    assert expected.refined
    assert points == pytest.approx(len(expected.points), rel=0.1)
    # Which views see enough to be moved may differ by a match, but the poses are as good.
    true = np.array([frame.camera.world_to_camera for frame in capture.train])
    found, theirs, before = (
        np.abs(np.reshape(matrices, (-1, 4, 4)) - true).mean()
        for matrices in (
            poses,
            [camera.world_to_camera for camera in expected.cameras],
            [frame.camera.world_to_camera for frame in frames],
        )
    )
    assert found < 1.1 * theirs
    assert found < 0.6 * before


def test_photographs_with_wrong_poses(call: Call) -> None:
    """One for training and one that is held out are placed anew; one of another place, mirrored, is left out.

    Of depth, which is not looked at, there is little.
    """
    capture = true_capture(width=144, height=108, frames=7, points=1)
    frames = [replace(f, camera=turned(f.camera, 30)) if i in (1, 5) else f for i, f in enumerate(capture.train)]
    frames[3] = replace(frames[3], image=np.ascontiguousarray(frames[3].image[:, ::-1]))
    script = (
        TYPED
        + OPEN_FINDER
        + """
        const { Stereo } = await import(new URL("prior/stereo.js", location.href));
        const depth = await (await fetch("depth_passes.json")).json();
        const { keyframes, depth_range: range } = settings.prior;
        Object.assign(keyframes, { max_keyframes: 2 });
        Object.assign(range, { wide_hypotheses: 16, fewest: 16, most: 16 });
        const stereo = await Stereo.open(device, depth, settings.prior.sweep);
        const [stages, warnings] = [[], []];
        const listener = { onStage: async (text) => stages.push(text), onWarning: (text) => warnings.push(text) };
        const [train, heldOut] = [framesOf(given.train), framesOf(given.heldOut)];
        const loaded = { train, heldOut, cloud: null, isMetric: true };
        const options = { gaussians: 2000, seed: 0, prior: "dense", refines: true };
        const { capture } = await module.prepared(loaded, options, settings, { stereo, finder }, listener);
        device.destroy();
        const kept = [...capture.train, ...capture.heldOut];
        const poses = kept.map(({ name, camera }) => [name, camera.world_to_camera]);
        return [Object.fromEntries(poses), capture.train.length, stages, warnings, complaints];
    """
    )
    given = {"train": plain_frames(frames[:5]), "heldOut": plain_frames(frames[5:])}
    poses, training, stages, warnings, complaints = call("training/preparation.js", script, given)
    names = [frame.name for frame in frames]
    assert complaints == []
    assert list(poses) == [*names[:3], *names[4:]]
    assert training == 4
    assert any(text.startswith("placing photographs anew, pair 1 of ") for text in stages)
    for i in (1, 5):
        np.testing.assert_allclose(
            np.reshape(poses[names[i]], (4, 4)), capture.train[i].camera.world_to_camera, atol=0.02
        )
    assert warnings == [
        "Some photographs have poses that the others contradict. "
        f"2 placed anew: {names[1]}, {names[5]}. 1 left out: {names[3]}."
    ]
