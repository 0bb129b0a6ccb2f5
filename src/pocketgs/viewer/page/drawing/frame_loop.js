/**
 * The frame loop: draws only after changes, first at the resolution that frames are quick at, and at full resolution
 * once nothing moves.
 *
 * @module
 */

/** Resolutions relative to the canvas. */
const SHARES = [1, 0.7, 0.5, 0.35, 0.25];

/** The resolution to begin with, while nothing is known about how long frames take. */
export const FIRST_SHARE = 0.25;

/** A frame slower than this lowers the resolution for motion, and a faster one than that raises it. */
const SLOW_FRAME = 50;
const QUICK_FRAME = 20;

/** Where a frame of full resolution takes longer than this, a coarse one comes before it. */
const LONG_FRAME = 300;

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
    /** Resolution for motion. */
    #share = FIRST_SHARE;
    /** Duration of the last frame of full resolution. */
    #fullTook = Infinity;
    #drawnShare = 0;
    #moved = -Infinity;
    #running = false;
    #lastTick = 0;

    /**
     * @param {(share: number, isWanted: () => boolean) => Promise<boolean>} draw a frame with this share of the full
     *     resolution; it may end early once it is not wanted any more, and returns whether it did not
     * @param {(milliseconds: number) => void} onDrawn called with the duration of each frame
     * @param {(rests: boolean) => void} onRest called when drawing begins, and when there is nothing left to draw
     */
    constructor(draw, onDrawn, onRest) {
        this.#draw = draw;
        this.#onDrawn = onDrawn;
        this.#onRest = onRest;
    }

    /** Redraw: something other than the camera has changed. */
    invalidate() {
        this.#changed++;
        this.#start();
    }

    /** Redraw, at the resolution for motion until nothing has moved for a while. */
    move() {
        this.#moved = performance.now();
        this.invalidate();
    }

    /** Redraw by another renderer, of whose speed nothing is known. */
    beginAnew() {
        [this.#share, this.#fullTook] = [FIRST_SHARE, Infinity];
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
        if (this.#changed !== this.#drawn) {
            await this.#frame(moving || this.#fullTook > LONG_FRAME ? this.#share : 1, () => true);
        } else if (!moving && this.#drawnShare < 1) {
            await this.#frame(1, () => this.#changed === this.#drawn);
        }
        if (moving || this.#changed !== this.#drawn || this.#drawnShare < 1) {
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

    async #frame(share, isWanted) {
        const change = this.#changed;
        const start = performance.now();
        const isComplete = await this.#draw(share, isWanted);
        const took = performance.now() - start;
        if (isComplete) {
            [this.#drawn, this.#drawnShare] = [change, share];
            this.#onDrawn(took);
        }
        this.#adapt(share, took, isComplete);
    }

    /** Choose the resolution for motion by the duration of a frame; one that ended early would have taken longer. */
    #adapt(share, took, isComplete) {
        const at = SHARES.indexOf(this.#share);
        if (share === 1) {
            this.#fullTook = isComplete ? took : Math.max(this.#fullTook, took);
        }
        if (isComplete && took < QUICK_FRAME && share >= this.#share) {
            this.#share = share > this.#share ? share : SHARES[Math.max(at - 1, 0)];
        } else if (took > SLOW_FRAME && share <= this.#share) {
            this.#share = SHARES[Math.min(at + 1, SHARES.length - 1)];
        }
    }
}
