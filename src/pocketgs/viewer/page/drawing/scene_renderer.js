/**
 * Rendering a scene with the best there is: as points, until the GPU has drawn it for the first time.
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
 * @property {() => Picture} pictureNow asked what is to be drawn
 * @property {() => void} onChange told when it would draw something else than before
 * @property {(milliseconds: number) => void} onSharp told when the GPU takes over, and what its first picture took
 * @property {(text: string) => void} onFault
 */

/** Draws points or on the GPU; says in the document when points are all there will be. */
export class SceneRenderer {
    #points;
    /** @type {PointRenderer | Renderer} what draws now */
    #drawing;
    /** @type {Renderer | null} */
    #gpu = null;
    /** @type {GaussianColumns | null} the whole one that is shown or about to be */
    #scene = null;
    #appearance = "splats";
    #pointsOnly = false;
    /** What brings scenes to the GPU, one after the other. */
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

    /** How many Gaussians are drawn. */
    get count() {
        return this.#drawing.count;
    }

    /** Whether nothing else will soon draw in place of what does. */
    get isSettled() {
        return this.#pointsOnly || this.#drawing === this.#gpu;
    }

    /**
     * Draw on the GPU, once a whole scene is there and its first picture done, until the GPU is lost.
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

    /** Draw points: they are all there will be, for now at least. */
    stayWithPoints() {
        this.#drawing = this.#points;
        if (this.#scene) {
            this.#points.setScene(this.#scene);
        }
        this.#setPointsOnly(true);
        this.#told.onChange();
    }

    /**
     * Draw what has arrived of a scene, unless a whole one is there.
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

    /** @param {GaussianColumns} scene to draw from now on: as points if the GPU's memory does not hold it */
    async setScene(scene) {
        this.#scene = scene;
        if (this.#drawing === this.#points) {
            this.#points.setScene(scene);
            this.#told.onChange();
        }
        await this.#sharpen();
    }

    /** @param {"splats" | "points" | "discs"} appearance to draw Gaussians in on the GPU from now on */
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
            // What a lost GPU had still to draw fails as well.
            if (drawing === this.#drawing) {
                this.#tell(error.message);
            }
        }
        if (drawing.count) {
            markOnce("first picture");
        }
    }

    /**
     * Draw, and encode what is then to be seen.
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
            // What a lost GPU had still to do fails as well.
            if (gpu === this.#gpu) {
                this.stayWithPoints();
                this.#tell(error.message);
            }
        }
    }

    /** Change from points to the GPU. Points go on being drawn while its first picture is. */
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

    /** Tell what is wrong with the GPU, but not the same again with every scene of a run or with every picture. */
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

/** Leave a mark for whoever measures how long it takes until something is to be seen. */
function markOnce(name) {
    if (performance.getEntriesByName(name).length === 0) {
        performance.mark(name);
    }
}
