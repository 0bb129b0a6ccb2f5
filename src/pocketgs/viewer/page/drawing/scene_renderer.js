/**
 * Renders a scene with the best renderer available: as points, until the GPU has drawn its first image.
 *
 * @module
 */

/**
 * @typedef {import("../scene/gaussian_columns.js").GaussianColumns} GaussianColumns
 * @typedef {import("./point_renderer.js").PointRenderer} PointRenderer
 * @typedef {import("./renderer.js").Picture} Picture
 * @typedef {import("./renderer.js").Renderer} Renderer
 *
 * @typedef {Object} Told
 * @property {() => Picture} pictureNow returns the parameters of the current image
 * @property {() => void} onChange called when the image would change
 * @property {(milliseconds: number) => void} onSharp called when the GPU takes over, with the time of its first image
 * @property {(text: string) => void} onFault
 */

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
     * Draw on the GPU, once a complete scene is there and its first image is done, until the GPU is lost.
     *
     * @param {Renderer} gpu
     */
    async useGpu(gpu) {
        this.#gpu = gpu;
        gpu.lost.then(({ message }) => {
            this.#gpu = null;
            this.stayWithPoints();
            this.#tell(`the GPU was lost (${message}): reload the page`);
        });
        await this.#sharpen();
    }

    /** Draw points, since there is no GPU, at least for now. */
    stayWithPoints() {
        this.#drawing = this.#points;
        if (this.#scene) {
            this.#points.setScene(this.#scene);
        }
        this.#setPointsOnly(true);
        this.#told.onChange();
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
    }

    /** @param {Picture} picture */
    async draw(picture) {
        const drawing = this.#drawing;
        try {
            await drawing.draw(picture);
        } catch (error) {
            // Pending work of a lost GPU fails as well.
            if (drawing === this.#drawing) {
                this.#tell(error.message);
            }
        }
        if (drawing.count) {
            markOnce("first picture");
        }
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
            if (this.#drawing === gpu) {
                this.#told.onChange();
            } else {
                await this.#takeOver(gpu);
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
        const [start, picture] = [performance.now(), this.#told.pictureNow()];
        await gpu.draw(picture);
        if (gpu !== this.#gpu) {
            return;
        }
        this.#drawing = gpu;
        this.#points.release();
        this.#setPointsOnly(false);
        this.#fault = null;
        markOnce("first sharp picture");
        this.#told.onSharp(performance.now() - start);
        if (JSON.stringify(picture) !== JSON.stringify(this.#told.pictureNow())) {
            this.#told.onChange();
        }
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
