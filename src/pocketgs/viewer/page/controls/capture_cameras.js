/**
 * Navigation between the capture's cameras, and comparison with their photographs.
 *
 * @module
 */

import { element } from "../element.js";
import { MovingCamera } from "../scene/camera.js";
import { extentOf } from "../scene/framing.js";
import { cross, normalised } from "../scene/vectors.js";
import { Comparison } from "./compare.js";

/**
 * @typedef {import("../drawing/scene_view.js").SceneView} SceneView
 *
 * @typedef {import("../scene/camera.js").Camera & {name: string, held_out: boolean, photo: string | null,
 *     transients: string | null}} View a camera of the capture; `transients` is a picture of its photograph in which
 *     red marks what training left out
 */

/** Moves the view from camera to camera. Held-out photographs can be compared, and those in which something moved. */
export class CaptureCameras {
    #view;
    #comparison;
    /** @type {View[]} */
    #views = [];
    #target = [0, 0, 0];
    #at = 0;
    /** @type {import("../scene/camera.js").Pose | null} the last destination */
    #pose = null;
    #extent = null;

    /** @param {SceneView} view */
    constructor(view) {
        this.#view = view;
        this.#comparison = new Comparison(view.camera);
    }

    /**
     * Replace the cameras, and go to the first held-out one, or the first; if there were cameras before, to the current
     * one, unless the user has moved on.
     *
     * @param {{cameras: View[], up: number[], target: number[]}} viewer from viewer.json
     */
    setViews({ cameras, up, target }) {
        const isFirst = this.#views.length === 0;
        this.#comparison.hide();
        this.#views = cameras;
        this.#target = target;
        this.#view.camera.up = up;
        this.#at = Math.min(this.#at, Math.max(cameras.length - 1, 0));
        if (isFirst) {
            this.#at = Math.max(0, cameras.findIndex((camera) => camera.held_out));
        }
        if (this.any && (isFirst || this.#view.camera.pose === this.#pose)) {
            this.#go(true);
        }
        this.#showButtons();
    }

    /**
     * Remove all cameras, and look at a whole scene from a distance.
     *
     * @param {import("../scene/gaussian_columns.js").GaussianColumns} scene
     * @param {number[]} up
     * @param {number} count number of its Gaussians that have arrived
     */
    frame(scene, up, count = scene.count) {
        this.setViews({ cameras: [], up, target: [0, 0, 0] });
        this.#extent = extentOf(scene, count);
        this.reset(true);
    }

    /**
     * Without cameras, frame a scene that is still arriving, as long as the user has not moved on.
     *
     * @param {import("../scene/gaussian_columns.js").GaussianColumns} scene
     * @param {number[]} up
     * @param {number} count number of its Gaussians that have arrived
     */
    frameArriving(scene, up, count = scene.count) {
        if (!this.any && (!this.#extent || this.#view.camera.pose === this.#pose)) {
            this.frame(scene, up, count);
        }
    }

    /** Whether there are any. */
    get any() {
        return this.#views.length > 0;
    }

    /** @param {1 | -1} step to the next or the previous; while comparing, only those with photographs */
    go(step) {
        const count = this.#views.length;
        for (let tried = 0; tried < count; tried++) {
            this.#at = (this.#at + step + count) % count;
            if (!this.#comparison.isOn || this.#isComparable(this.#views[this.#at])) {
                break;
            }
        }
        if (count) {
            this.#go(this.#comparison.isOn);
            if (this.#comparison.isOn) {
                this.#showPhotograph();
            }
        }
    }

    /** Go back to the camera, or to where the whole scene is visible. */
    reset(atOnce = false) {
        if (this.any) {
            this.#go(atOnce);
        } else if (this.#extent) {
            const { middle, radius } = this.#extent;
            const { camera } = this.#view;
            camera.takeUsualLens();
            const [sideways, backwards] = aside(camera.up);
            const place = middle.map((value, i) => {
                return value + radius * (0.6 * sideways[i] + 2.2 * backwards[i] + 0.8 * camera.up[i]);
            });
            this.#pose = camera.poseTowards(place, middle);
            this.#view.goTo(this.#pose, camera.lens, atOnce);
        }
    }

    /** Show the photograph over the rendering, or hide it. */
    compare() {
        if (this.#comparison.isOn) {
            this.stopComparing();
            return;
        }
        if (!this.#views.some((view) => this.#isComparable(view))) {
            return;
        }
        while (!this.#isComparable(this.#views[this.#at])) {
            this.#at = (this.#at + 1) % this.#views.length;
        }
        this.#go(true);
        this.#showPhotograph();
    }

    /** Stop comparing, since the camera has moved. */
    stopComparing() {
        this.#comparison.hide();
        this.#view.moved();
    }

    #isComparable(view) {
        const shown = view.photo && (view.held_out || !this.#views.some((other) => other.held_out && other.photo));
        return Boolean(shown || view.transients);
    }

    #showPhotograph() {
        const { name, photo, transients } = this.#views[this.#at];
        this.#comparison.show({ name, photo: transients ?? photo });
    }

    #go(atOnce) {
        const view = this.#views[this.#at];
        this.#pose = MovingCamera.poseOf(view, this.#target);
        this.#view.goTo(this.#pose, view, atOnce);
        const notes = [view.held_out && ", held out", view.transients && ", red: moved, left out"];
        element("camera-name").textContent = view.name + notes.filter(Boolean).join("");
    }

    #showButtons() {
        element("previous").disabled = element("next").disabled = !this.any;
        element("compare-button").disabled = !this.#views.some((view) => this.#isComparable(view));
        element("camera-name").hidden = !this.any;
    }
}

/** Two unit vectors perpendicular to a unit vector and to each other. */
function aside(up) {
    const least = up.map(Math.abs).indexOf(Math.min(...up.map(Math.abs)));
    const other = [0, 1, 2].map((axis) => Number(axis === least));
    const sideways = normalised(cross(up, other));
    return [sideways, cross(up, sideways)];
}
