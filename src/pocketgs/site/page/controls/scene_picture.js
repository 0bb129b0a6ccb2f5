/**
 * The picture of the scene, which the user turns; the worker draws it.
 *
 * @module
 */

import { PointerControls } from "../../page/controls/pointer.js";
import { FrameLoop } from "../../page/drawing/frame_loop.js";
import { MovingCamera } from "../../page/scene/camera.js";
import { listenToPictureKeys } from "./picture_keys.js";

/** Milliseconds between pictures while only training goes on. */
const BETWEEN_PICTURES = 1000;

/** Asks for pictures, and shows them. */
export class ScenePicture {
    #canvas;
    #camera = new MovingCamera();
    #ask;
    #loop;
    #arrived = () => {};
    #latest = 0;
    #first = null;

    /**
     * @param {HTMLCanvasElement} canvas
     * @param {(camera: import("../../page/scene/camera.js").Camera) => void} ask for a picture
     * @param {() => void} onMove called when the user has moved the camera
     */
    constructor(canvas, ask, onMove) {
        this.#canvas = canvas;
        this.#ask = ask;
        this.#camera.showsAll = true;
        this.#loop = new FrameLoop((share) => this.#draw(share), () => {}, () => {});
        const moved = () => {
            onMove();
            this.#loop.move();
        };
        new PointerControls(canvas, this.#camera, moved);
        listenToPictureKeys(canvas, this.#camera, moved);
        new ResizeObserver(() => this.#first && this.#loop.invalidate()).observe(canvas);
    }

    /**
     * A run begins.
     *
     * @param {import("../training/first_view.js").firstView} first
     */
    begin(first) {
        this.#first = first;
        // What the last run was asked for will not come any more.
        this.#arrived();
        this.reset();
    }

    /** Back to where the photograph was taken. */
    reset() {
        const { camera, target, up } = this.#first;
        this.#camera.lens = camera;
        this.#camera.up = up;
        this.#camera.pose = MovingCamera.poseOf(camera, target);
        this.#loop.invalidate();
    }

    /** The scene has changed a little. */
    refresh() {
        if (performance.now() - this.#latest > BETWEEN_PICTURES) {
            this.redraw();
        }
    }

    /** The scene has changed. */
    redraw() {
        this.#loop.invalidate();
    }

    /**
     * The answer to what was asked for.
     *
     * @param {{width: number, height: number, rgba: Uint8ClampedArray} | null} picture null to leave the last one
     */
    show(picture) {
        if (picture) {
            const { width, height, rgba } = picture;
            [this.#canvas.width, this.#canvas.height] = [width, height];
            this.#canvas.getContext("2d").putImageData(new ImageData(rgba, width, height), 0, 0);
        }
        this.#latest = performance.now();
        this.#arrived(true);
    }

    #draw(share) {
        const size = [this.#canvas.clientWidth, this.#canvas.clientHeight].map((side) => Math.round(share * side));
        if (Math.min(...size) < 1) {
            return Promise.resolve(true);
        }
        return new Promise((resolve) => {
            this.#arrived = resolve;
            this.#ask(this.#camera.of(...size));
        });
    }
}
