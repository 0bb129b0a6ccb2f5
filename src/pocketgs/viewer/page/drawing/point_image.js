/**
 * A software-rendered image of points, each an opaque disc with depth test.
 *
 * @module
 */

/**
 * @typedef {import("../scene/camera.js").Camera} Camera
 * @typedef {import("./points.js").Points} Points
 */

/** Maximum radius of a disc at full resolution, in pixels, so that points near the camera do not slow down drawing. */
const MAX_RADIUS = 64;

/** Pixels and their depths. */
export class PointImage {
    #depths;
    #pixels;

    /**
     * @param {number} width
     * @param {number} height
     */
    constructor(width, height) {
        this.#depths = new Float32Array(width * height);
        this.data = new ImageData(width, height);
        this.#pixels = new Uint32Array(this.data.data.buffer);
    }

    /**
     * Clear and draw.
     *
     * @param {Points} points
     * @param {Camera} camera whose image has this image's size
     * @param {number} share resolution relative to the full one
     * @param {[number, number, number]} background RGB
     */
    draw(points, camera, share, background) {
        const [red, green, blue] = background.map((value) => Math.round(255 * value));
        this.#pixels.fill(0xff000000 | (blue << 16) | (green << 8) | red);
        this.#depths.fill(Infinity);
        const { fx, fy, cx, cy, world_to_camera: m } = camera;
        const { x, y, z, radii, colours, near } = points;
        const largest = share * MAX_RADIUS;
        for (let i = 0; i < points.count; i++) {
            const depth = m[8] * x[i] + m[9] * y[i] + m[10] * z[i] + m[11];
            if (radii[i] > 0 && depth >= near) {
                const across = cx + (fx * (m[0] * x[i] + m[1] * y[i] + m[2] * z[i] + m[3])) / depth;
                const down = cy + (fy * (m[4] * x[i] + m[5] * y[i] + m[6] * z[i] + m[7])) / depth;
                const radius = Math.min((fy * radii[i]) / depth, largest);
                this.#drawDisc(across, down, radius, depth, colours[i]);
            }
        }
    }

    /** Draw the pixels whose centres are in a disc, or the pixel it lies in if there are none. */
    #drawDisc(across, down, radius, depth, colour) {
        const { width, height } = this.data;
        const reach = Math.max(radius, 0.5);
        const top = Math.max(Math.ceil(down - reach - 0.5), 0);
        const bottom = Math.min(Math.floor(down + reach - 0.5), height - 1);
        for (let row = top; row <= bottom; row++) {
            const below = row + 0.5 - down;
            const half = Math.max(Math.sqrt(Math.max(radius * radius - below * below, 0)), 0.5);
            const left = Math.max(Math.ceil(across - half - 0.5), 0);
            const right = Math.min(Math.floor(across + half - 0.5), width - 1);
            for (let pixel = row * width + left; pixel <= row * width + right; pixel++) {
                if (depth < this.#depths[pixel]) {
                    this.#depths[pixel] = depth;
                    this.#pixels[pixel] = colour;
                }
            }
        }
    }
}
