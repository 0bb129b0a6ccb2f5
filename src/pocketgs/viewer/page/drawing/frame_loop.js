/**
 * The frame loop: draws only after changes, and at lower resolution during motion if frames are slow.
 *
 * @module
 */

/** Resolutions relative to the canvas. */
const SHARES = [1, 0.7, 0.5, 0.35, 0.25];

/** During motion, a frame slower than this lowers the resolution, and a faster one than that raises it. */
const SLOW_FRAME = 50;
const QUICK_FRAME = 20;

/** Milliseconds without changes after which the image is drawn at full resolution. */
const REST = 200;

/** Draws the frames. */
export class FrameLoop {
    #draw;
    #onDrawn;
    #onRest;
    #movers = new Set();
    #changed = 0;
    #drawn = 0;
    #share = 1;
    #drawnShare = 0;
    #moved = 0;
    #running = false;
    #lastTick = 0;

    /**
     * @param {(share: number) => Promise<void>} draw a frame with this share of the full resolution
     * @param {(milliseconds: number) => void} onDrawn called with the duration of each frame
     * @param {(rests: boolean) => void} onRest called when drawing begins, and when there is nothing left to draw
     */
    constructor(draw, onDrawn, onRest) {
        this.#draw = draw;
        this.#onDrawn = onDrawn;
        this.#onRest = onRest;
    }

    /** Redraw at full resolution: something other than the camera has changed. */
    invalidate() {
        this.#changed++;
        this.#start();
    }

    /** Redraw, at the resolution for motion until nothing has moved for a while. */
    move() {
        this.#moved = performance.now();
        this.invalidate();
    }

    /**
     * Call a function before every frame until it returns false.
     *
     * @param {(seconds: number) => boolean} mover called with the time since the last frame; returns whether it
     *     continues
     */
    addMover(mover) {
        this.#movers.add(mover);
        this.move();
    }

    #start() {
        if (!this.#running) {
            this.#running = true;
            this.#onRest(false);
            this.#lastTick = performance.now();
            requestAnimationFrame(() => this.#tick());
        }
    }

    async #tick() {
        const now = performance.now();
        this.#runMovers((now - this.#lastTick) / 1000);
        this.#lastTick = now;
        const moving = now - this.#moved < REST;
        const share = moving ? this.#share : 1;
        if (this.#changed !== this.#drawn || share > this.#drawnShare) {
            await this.#frame(share, moving);
        }
        if (moving || this.#changed !== this.#drawn) {
            requestAnimationFrame(() => this.#tick());
        } else {
            this.#running = false;
            this.#onRest(true);
        }
    }

    #runMovers(seconds) {
        for (const mover of this.#movers) {
            this.#moved = performance.now();
            this.#changed++;
            if (!mover(seconds)) {
                this.#movers.delete(mover);
            }
        }
    }

    async #frame(share, moving) {
        const change = this.#changed;
        const start = performance.now();
        await this.#draw(share);
        const took = performance.now() - start;
        this.#drawn = change;
        this.#drawnShare = share;
        this.#onDrawn(took);
        if (moving) {
            this.#adapt(took);
        }
    }

    #adapt(took) {
        const at = SHARES.indexOf(this.#share);
        if (took > SLOW_FRAME) {
            this.#share = SHARES[Math.min(at + 1, SHARES.length - 1)];
        } else if (took < QUICK_FRAME) {
            this.#share = SHARES[Math.max(at - 1, 0)];
        }
    }
}
