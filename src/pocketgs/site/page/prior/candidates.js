/**
 * Pixels that may become points; see `Candidates` in `prior/cloud/merge.py`.
 *
 * @module
 */

/** Grows up to a number that is known before. */
export class Candidates {
    count = 0;

    /** @param {number} most */
    constructor(most) {
        /** (M, 3) in the world */
        this.positions = new Float64Array(3 * most);
        /** (M, 3) RGB in [0, 1] */
        this.colours = new Float32Array(3 * most);
        /** (M, 3) unit vectors towards the camera */
        this.directions = new Float32Array(3 * most);
        /** (M,) footprint of a pixel there */
        this.footprints = new Float32Array(most);
        /** (M,) local contrast in [0, 1] */
        this.details = new Float32Array(most);
        /** (M,) in [0, 1] */
        this.confidences = new Float32Array(most);
    }

    /**
     * @param {ArrayLike<number>} position
     * @param {ArrayLike<number>} colour
     * @param {ArrayLike<number>} direction
     * @param {number} footprint
     * @param {number} detail
     * @param {number} confidence
     */
    add(position, colour, direction, footprint, detail, confidence) {
        this.positions.set(position, 3 * this.count);
        this.colours.set(colour, 3 * this.count);
        this.directions.set(direction, 3 * this.count);
        this.footprints[this.count] = footprint;
        this.details[this.count] = detail;
        this.confidences[this.count] = confidence;
        this.count++;
    }

    /** Leave some out. @param {Uint8Array} unwanted (count,) 1 for these */
    drop(unwanted) {
        const kept = Uint32Array.from(unwanted.keys()).filter((i) => !unwanted[i]);
        for (const rows of [this.positions, this.colours, this.directions]) {
            kept.forEach((from, to) => rows.copyWithin(3 * to, 3 * from, 3 * from + 3));
        }
        for (const values of [this.footprints, this.details, this.confidences]) {
            kept.forEach((from, to) => (values[to] = values[from]));
        }
        this.count = kept.length;
    }
}
