/**
 * Renders a scene with the best renderer available: as points, until the GPU has drawn its first image.
 *
 * @module
 */

import { FIRST_SHARE } from "./frame_loop.js";
import { tried } from "./opening.js";

/**
 * @typedef {import("../scene/gaussian_columns.js").GaussianColumns} GaussianColumns
 * @typedef {import("./point_renderer.js").PointRenderer} PointRenderer
 * @typedef {import("./renderer.js").Picture} Picture
 * @typedef {import("./renderer.js").Renderer} Renderer
 *
 * @typedef {Object} Told
 * @property {(share: number) => Picture} pictureNow returns the parameters of the current image at a share of the full
 *     resolution
 * @property {() => void} onChange called when the image would change
 * @property {() => void} onTakeOver called when another renderer draws from now on, or images that may take much longer
 * @property {(done: Promise<void>) => void} onRegaining called when a GPU was lost; `done` resolves when it is
 *     open again, or given up
 * @property {(text: string) => void} onNote called with what is worth a quiet line
 * @property {(text: string) => void} onFault
 */

/** A GPU that is lost more often than this, each time within so many milliseconds of work, is not opened again. */
const MAX_LOSSES = 3;
const LASTING = 60_000;

/** Draws points or on the GPU; marks the document when only points are possible. */
export class SceneRenderer {
    #points;
    /** @type {PointRenderer | Renderer} the current renderer */
    #drawing;
    /** @type {Renderer | null} */
    #gpu = null;
    /** @type {GaussianColumns | null} the complete scene that is shown or about to be */
    #scene = null;
    #appearance = "splats";
    #pointsOnly = false;
    #losses = 0;
    /** Queue of scenes to upload to the GPU. */
    #sharpening = Promise.resolve();
    #told;
    #fault = null;

    /**
     * @param {PointRenderer} points
     * @param {Told} told
     */
    constructor(points, told) {
        this.#points = this.#drawing = points;
        this.#told = told;
    }

    /** Number of Gaussians drawn. */
    get count() {
        return this.#drawing.count;
    }

    /** Size of the scene's file, or 0. */
    get fileBytes() {
        return this.#scene?.fileBytes ?? 0;
    }

    /** Share of the full resolution that images have at most: less on a GPU that was lost over them. */
    get largestShare() {
        return this.#drawing === this.#points ? 1 : this.#largestOnGpu;
    }

    get #largestOnGpu() {
        return 0.5 ** this.#losses;
    }

    /** How Gaussians come together in an image. */
    get compositor() {
        const weighting = this.#appearance === "splats" && this.#scene?.weighting;
        return this.#pointsOnly ? "points" : weighting ? `sort-free: ${weighting.form}` : "sorted";
    }

    /** Whether no other renderer will replace the current one soon. */
    get isSettled() {
        return this.#pointsOnly || this.#drawing === this.#gpu;
    }

    /**
     * Draw on the GPU, once a complete scene is there and its first image is done. A lost GPU is opened again, to draw
     * smaller images.
     *
     * @param {Renderer} gpu
     * @param {() => Promise<Renderer>} reopen opens it again
     */
    async useGpu(gpu, reopen) {
        this.#gpu = gpu;
        const start = performance.now();
        gpu.lost.then(({ message }) => {
            this.#gpu = null;
            this.#losses += Number(performance.now() - start < LASTING);
            this.#told.onRegaining(this.#regain(message, reopen));
        });
        await this.#sharpen();
    }

    /** Draw points, since there is no GPU, at least for now. */
    stayWithPoints() {
        this.#drawPoints();
        this.#setPointsOnly(true);
    }

    /**
     * Draw the loaded part of a scene, unless a complete one is there.
     *
     * @param {GaussianColumns} scene
     * @param {number} count of its Gaussians, from the first on
     * @returns {boolean} whether it is drawn
     */
    showPart(scene, count) {
        if (this.#scene) {
            return false;
        }
        this.#points.setScene(scene, count);
        this.#told.onChange();
        return true;
    }

    /** @param {GaussianColumns} scene to draw; as points if it does not fit in the GPU's memory */
    async setScene(scene) {
        this.#scene = scene;
        if (this.#drawing === this.#points) {
            this.#points.setScene(scene);
            this.#told.onChange();
        }
        await this.#sharpen();
    }

    /** @param {"splats" | "points" | "discs"} appearance of Gaussians on the GPU */
    async setAppearance(appearance) {
        await this.#gpu?.setAppearance(appearance);
        this.#appearance = appearance;
        if (this.#gpu?.isUntried && this.#drawing === this.#gpu) {
            this.#told.onTakeOver();
        }
    }

    /**
     * @param {Picture} picture
     * @param {() => boolean} isWanted asked now and then; drawing ends early once it is not
     * @returns {Promise<boolean>} whether it is complete
     */
    async draw(picture, isWanted) {
        const drawing = this.#drawing;
        try {
            if (!(await drawing.draw(picture, isWanted))) {
                return false;
            }
        } catch (error) {
            // Pending work of a lost GPU fails as well.
            if (drawing === this.#drawing) {
                this.#tell(error.message);
            }
        }
        if (drawing.count) {
            markOnce("first picture");
        }
        if (drawing === this.#gpu && picture.isSharp) {
            markOnce("first sharp picture");
        }
        return true;
    }

    /**
     * Draw, and encode the result.
     *
     * @param {Picture} picture
     * @returns {Promise<Blob>} a PNG
     */
    photograph(picture) {
        return this.#drawing.photograph(picture);
    }

    #sharpen() {
        this.#sharpening = this.#sharpening.then(() => this.#bringToGpu());
        return this.#sharpening;
    }

    async #bringToGpu() {
        const [gpu, scene] = [this.#gpu, this.#scene];
        if (!gpu || !scene) {
            return;
        }
        try {
            await gpu.setAppearance(this.#appearance);
            await gpu.setScene(scene);
            if (this.#drawing !== gpu) {
                await this.#takeOver(gpu);
            } else if (gpu.isUntried) {
                this.#told.onTakeOver();
            } else {
                this.#told.onChange();
            }
        } catch (error) {
            // Pending work of a lost GPU fails as well.
            if (gpu === this.#gpu) {
                this.stayWithPoints();
                this.#tell(error.message);
            }
        }
    }

    /** Switch from points to the GPU. Points are drawn until its first image is done. */
    async #takeOver(gpu) {
        let isDone = false;
        while (gpu === this.#gpu && !isDone) {
            isDone = await gpu.draw(this.#told.pictureNow(Math.min(FIRST_SHARE, this.#largestOnGpu)));
        }
        if (gpu !== this.#gpu) {
            return;
        }
        this.#drawing = gpu;
        this.#points.release();
        this.#setPointsOnly(false);
        this.#fault = null;
        this.#told.onTakeOver();
    }

    #drawPoints() {
        this.#drawing = this.#points;
        if (this.#scene) {
            this.#points.setScene(this.#scene);
        }
        this.#told.onTakeOver();
    }

    /** Open a lost GPU again, and draw points meanwhile. */
    async #regain(message, reopen) {
        this.#drawPoints();
        const gpu = this.#losses <= MAX_LOSSES && (await tried(reopen).catch(() => null));
        if (!gpu) {
            this.stayWithPoints();
            this.#told.onNote("");
            this.#tell(`the GPU was lost (${message}): reload the page`);
            return;
        }
        const resolution = this.#losses ? `${100 * this.#largestOnGpu} %` : "the same";
        this.#told.onNote(`the GPU was lost: now at ${resolution} resolution`);
        await this.useGpu(gpu, reopen);
    }

    /** Report an error of the GPU, but not repeatedly for every scene of a run or every image. */
    #tell(fault) {
        if (fault !== this.#fault) {
            this.#fault = fault;
            this.#told.onFault(fault);
        }
    }

    #setPointsOnly(pointsOnly) {
        this.#pointsOnly = pointsOnly;
        document.body.classList.toggle("points-only", pointsOnly);
    }
}

/** Set a performance mark, once. */
function markOnce(name) {
    if (performance.getEntriesByName(name).length === 0) {
        performance.mark(name);
    }
}
