/**
 * The viewer's camera, and its motion: orbiting, panning and zooming.
 *
 * @module
 */

import { add, axesOf, cross, dot, length, mix, normalised, product, rotationTo, slerp, subtract, turn, unit } from "./vectors.js";

/**
 * @typedef {import("./vectors.js").Vector} Vector
 * @typedef {import("./vectors.js").Quaternion} Quaternion
 *
 * @typedef {Object} Camera a pinhole camera in OpenCV axes: x right, y down, z forward, pixel centres at + 0.5
 * @property {number} width
 * @property {number} height
 * @property {number} fx
 * @property {number} fy
 * @property {number} cx
 * @property {number} cy
 * @property {number[]} world_to_camera 16 numbers, row by row
 *
 * @typedef {Object} Pose
 * @property {Vector} centre of the camera, in the world
 * @property {Quaternion} rotation from the camera's axes to the world's
 * @property {number} distance from the centre to the target, along the optical axis
 */

/** Minimum angle between the optical axis and the vertical, in radians: beyond it the view would be upside down. */
const MIN_ANGLE_TO_VERTICAL = 0.05;

/** Default lens for scenes without cameras: 50 degrees across the shorter side. */
const USUAL_LENS = { width: 1, height: 1, fx: 1.07, fy: 1.07, cx: 0.5, cy: 0.5 };

/** A camera that the user moves. */
export class MovingCamera {
    /** @type {Pose} */
    pose = { centre: [0, 0, -3], rotation: [1, 0, 0, 0], distance: 3 };
    /** @type {Vector} */
    up = [0, -1, 0];
    /** The camera whose field of view is shown. */
    lens = USUAL_LENS;
    /** Whether all of the lens's image must be visible, even if a canvas of another shape then shows much more. */
    showsAll = false;

    /** Axes of the camera in the world: right, down, forward. */
    get axes() {
        return axesOf(this.pose.rotation);
    }

    /** @returns {Vector} */
    get target() {
        return add(this.pose.centre, this.axes[2], this.pose.distance);
    }

    /**
     * Position of the lens's image in a larger one, centred. Unless all of it must be visible, its size is halfway
     * between fitting inside and filling.
     *
     * @param {number} width
     * @param {number} height
     */
    frameIn(width, height) {
        const scales = [width / this.lens.width, height / this.lens.height];
        const scale = this.showsAll ? Math.min(...scales) : Math.sqrt(scales[0] * scales[1]);
        const size = { width: scale * this.lens.width, height: scale * this.lens.height };
        return { scale, left: (width - size.width) / 2, top: (height - size.height) / 2, ...size };
    }

    /**
     * A camera for an image of any shape with about the field of view of the lens.
     *
     * @param {number} width
     * @param {number} height
     * @returns {Camera}
     */
    of(width, height) {
        const { scale, left, top } = this.frameIn(width, height);
        const { fx, fy, cx, cy } = this.lens;
        const rows = this.axes.flatMap((axis) => [...axis, -dot(axis, this.pose.centre)]);
        return {
            width,
            height,
            fx: scale * fx,
            fy: scale * fy,
            cx: scale * cx + left,
            cy: scale * cy + top,
            world_to_camera: [...rows, 0, 0, 0, 1],
        };
    }

    /**
     * Orbit the target, so that what is in front of it follows the pointer.
     *
     * @param {number} right radians about the vertical
     * @param {number} down radians about the camera's own x axis
     */
    orbit(right, down) {
        const { target, up } = this;
        const [across, , forward] = this.axes;
        const toVertical = Math.acos(Math.max(-1, Math.min(1, dot(forward, up))));
        const limit = MIN_ANGLE_TO_VERTICAL;
        const allowed = Math.max(limit, Math.min(Math.PI - limit, toVertical + down)) - toVertical;
        const turned = product(product(turn(up, -right), turn(across, -allowed)), this.pose.rotation);
        const rotation = unit(turned);
        this.pose = { ...this.pose, rotation, centre: add(target, axesOf(rotation)[2], -this.pose.distance) };
    }

    /**
     * Pan in the image plane, so that the target follows the pointer.
     *
     * @param {number} right share of the image's shorter side
     * @param {number} down likewise
     */
    pan(right, down) {
        const extent = this.pose.distance * this.#shorterSide();
        this.move([-right * extent, -down * extent, 0]);
    }

    /** @param {number} factor on the distance to the target */
    zoom(factor) {
        const { target } = this;
        const distance = this.pose.distance * factor;
        this.pose = { ...this.pose, distance, centre: add(target, this.axes[2], -distance) };
    }

    /** @param {Vector} step right, down, forward, in scene units; the target moves too */
    move(step) {
        const centre = this.axes.reduce((place, axis, i) => add(place, axis, step[i]), this.pose.centre);
        this.pose = { ...this.pose, centre };
    }

    /**
     * The pose of a capture's camera.
     *
     * @param {Camera} camera
     * @param {Vector} target of the scene, which determines the orbit distance
     * @returns {Pose}
     */
    static poseOf({ world_to_camera: m }, target) {
        const axes = [0, 1, 2].map((row) => m.slice(4 * row, 4 * row + 3));
        const centre = axes.reduce((place, axis, row) => add(place, axis, -m[4 * row + 3]), [0, 0, 0]);
        const toTarget = subtract(target, centre);
        const along = dot(axes[2], toTarget);
        return { centre, rotation: rotationTo(axes), distance: along > 0 ? along : length(toTarget) || 1 };
    }

    /**
     * The pose at `centre`, looking at `target`.
     *
     * @param {Vector} centre
     * @param {Vector} target
     * @returns {Pose}
     */
    poseTowards(centre, target) {
        const forward = normalised(subtract(target, centre));
        const right = normalised(cross(forward, this.up));
        const rotation = rotationTo([right, cross(forward, right), forward]);
        return { centre, rotation, distance: length(subtract(target, centre)) };
    }

    /** Use the default lens, for a scene without cameras. */
    takeUsualLens() {
        this.lens = USUAL_LENS;
    }

    /** Extent of the view at distance 1. */
    #shorterSide() {
        return Math.min(this.lens.width / this.lens.fx, this.lens.height / this.lens.fy);
    }
}

/**
 * Interpolate between two poses.
 *
 * @param {Pose} from
 * @param {Pose} to
 * @param {number} share 0 to 1
 * @returns {Pose}
 */
export function between(from, to, share) {
    return {
        centre: mix(from.centre, to.centre, share),
        rotation: slerp(from.rotation, to.rotation, share),
        distance: from.distance + share * (to.distance - from.distance),
    };
}

/**
 * Interpolate between two lenses, which may have different sizes.
 *
 * @param {Camera} from
 * @param {Camera} to
 * @param {number} share 0 to 1
 */
export function lensBetween(from, to, share) {
    const names = ["width", "height", "fx", "fy", "cx", "cy"];
    return Object.fromEntries(names.map((name) => [name, from[name] + share * (to[name] - from[name])]));
}
