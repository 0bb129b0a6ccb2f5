"""Pictures of the scene while it trains: none of them ends the training, and keys turn them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Call = Callable[..., Any]

CAMERA = {"width": 9, "height": 6, "fx": 10, "fy": 10, "cx": 4.5, "cy": 3}

RUN = """
    const {PictureError} = await import(new URL("training/trainer.js", location.href));
    const camera = {...given.camera, world_to_camera: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]};
    const told = [];
    const listener = {
        onPicture: (picture) => told.push(picture && [picture.width, picture.height, picture.rgba.length]),
        onComplaint: (text) => told.push(text),
        onCheckpoint: async () => {},
    };
    const download = async () => ({});
    const state = async () => ({moments: []});
    const render = async ({width, height}) => {
        if (width > given.most) {
            throw given.isLost ? new Error("lost") : new PictureError("full");
        }
        return new Float32Array(4 * width * height);
    };
    const capture = {train: [], heldOut: []};
    const run = new module.Run({render, download, state}, capture, settings, {}, listener);
    const serving = run.serve().catch(({message}) => told.push(message));
    for (let i = 0; i < 2; i++) {
        run.look(camera);
        await new Promise((resolve) => setTimeout(resolve, 10));
    }
    run.close();
    await serving;
    return told;
"""


def looked(call: Call, most: int, is_lost: bool = False) -> list[Any]:
    return list(call("training/run.js", RUN, {"camera": CAMERA, "most": most, "isLost": is_lost}))


def test_a_picture_without_room_is_drawn_smaller_or_not_at_all(call: Call) -> None:
    assert looked(call, most=9) == [[9, 6, 216]] * 2
    assert looked(call, most=5) == [[5, 3, 60]] * 2
    assert looked(call, most=4) == ["The scene cannot be drawn: full", None, None]
    assert looked(call, most=4, is_lost=True) == ["lost"]


TRAIN = """
    const {Description} = await import(new URL("../gpu/description.js", location.href));
    const {GaussianColumns} = await import(new URL("../page/scene/gaussian_columns.js", location.href));
    const description = new Description(await (await fetch(new URL("passes.json", location.href))).json());
    // A GPU that only counts: pictures wider than the photograph need more room in the lists of tiles.
    const [status, sizes, submitted] = [[0, 0, 0], {}, []];
    const executor = {
        description,
        largestBuffer: 2 ** 30,
        free: () => {},
        buffer: (name) => ({size: sizes[name]}),
        reserve: async (wanted) => {
            const grown = Object.keys(wanted).filter((name) => !(sizes[name] >= wanted[name]));
            grown.forEach((name) => (sizes[name] = wanted[name]));
            if (sizes.image > given.largestImage) {
                grown.forEach((name) => delete sizes[name]);
                throw new Error("the GPU's memory is full");
            }
        },
        write: (name, values) => name === "status" && status.splice(0, 3, ...values),
        clear: () => {},
        finished: async () => {},
        writeUniform: () => {},
        submit: (name, {intersections, width}) => {
            const needed = width > 8 ? 100_000 : 1000;
            if (!status[1] && needed > intersections) {
                status.splice(1, 2, 1, needed);
            }
            submitted.push([name, intersections, status[1]]);
            status[0] += Number(name === "step" && !status[1]);
        },
        read: async (name, type, count) => name === "status" ? type.from(status.slice(0, count)) : new type(count),
    };
    const camera = (width, height) => {
        return {width, height, fx: 8, fy: 8, cx: 4, cy: 3, world_to_camera: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 2]};
    };
    const trainer = new module.Trainer(executor, settings);
    trainer.mostBytes = given.bytes;
    const frame = {camera: camera(8, 6), rgba: new Uint8ClampedArray(4 * 48), mask: null};
    await trainer.begin([frame], [0, 0, 0], new GaussianColumns(10, 1));
    const step = async () => {
        trainer.step(0, settings.recipe.rates);
        await trainer.settle();
    };
    await step();
    const before = Object.keys(sizes).sort().join();
    const fault = await trainer.render(camera(16, 12)).then(() => null, ({message}) => message);
    const after = Object.keys(sizes).sort().join();
    await step();
    return {fault, isWhole: before === after, steps: trainer.losses.length, last: submitted.at(-1)};
"""
"""One step, a larger picture, another step."""


@pytest.mark.parametrize(
    ("limits", "fault"),
    [
        ({"bytes": 4e6}, "100,000 places where splats meet tiles do not fit"),
        ({"bytes": 1e9, "largestImage": 16 * 100}, "the GPU's memory is full"),
    ],
)
def test_a_picture_that_fails_leaves_the_next_step_as_it_was(call: Call, limits: dict[str, float], fault: str) -> None:
    found = call("training/trainer.js", TRAIN, {"largestImage": 1e9, **limits})
    assert found.pop("fault").startswith(fault)
    assert found == {"isWhole": True, "steps": 2, "last": ["step", 65_536, 0]}


def test_a_picture_makes_room_where_there_is_some(call: Call) -> None:
    found = call("training/trainer.js", TRAIN, {"largestImage": 1e9, "bytes": 1e9})
    assert found == {"fault": None, "isWhole": True, "steps": 2, "last": ["step", 125_000, 0]}


KEYS = """
    const {centreOf} = await import(new URL("capture/camera.js", location.href));
    document.body.innerHTML = '<canvas style="width: 30px; height: 20px" tabindex="0"></canvas>';
    const canvas = document.querySelector("canvas");
    const centres = [];
    let moves = 0;
    const picture = new module.ScenePicture(canvas, (camera) => {
        centres.push(centreOf(camera));
        setTimeout(() => picture.show(null));
    }, () => moves++);
    const identity = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
    const camera = {width: 30, height: 20, fx: 20, fy: 20, cx: 15, cy: 10, world_to_camera: identity};
    const after = async (change) => {
        const before = centres.length;
        change();
        while (centres.length === before) {
            await new Promise((resolve) => setTimeout(resolve, 20));
        }
        return centres.at(-1);
    };
    const found = [];
    for (const [key, ctrlKey] of given) {
        await after(() => picture.begin({camera, target: [0, 0, 2], up: [0, -1, 0]}));
        const event = new KeyboardEvent("keydown", {key, ctrlKey, cancelable: true, bubbles: true});
        const centre = ctrlKey ? canvas.dispatchEvent(event) : await after(() => canvas.dispatchEvent(event));
        found.push([event.defaultPrevented, centre]);
    }
    return [found, moves];
"""


def test_keys_turn_the_picture(call: Call) -> None:
    """The way that dragging turns it: what is in front follows."""
    keys = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "+", "=", "-"]
    given = [*((key, False) for key in keys), ("+", True)]
    (*found, zooming), moves = call("controls/scene_picture.js", KEYS, given)
    assert zooming == [False, True]
    assert moves == len(keys)
    assert all(prevented for prevented, _ in found)
    left, right, up, down, plus, equals, minus = (np.array(centre) for _, centre in found)
    assert left[0] > 0.1 > -0.1 > right[0]
    assert up[1] > 0.1 > -0.1 > down[1]
    np.testing.assert_allclose([plus, equals, minus], [[0, 0, 0.2], [0, 0, 0.2], [0, 0, 2 - 2 / 0.9]], atol=1e-9)
