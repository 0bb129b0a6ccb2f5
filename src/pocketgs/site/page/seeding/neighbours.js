/**
 * Nearest neighbours by a k-d tree (Friedman, Bentley and Finkel 1977).
 *
 * @module
 */

/** At most so many points lie in a leaf. */
const LEAF = 8;

/** Points, sorted so that every half of a range lies on one side of a plane. */
export class NeighbourTree {
    #positions;
    #order;

    /** @param {Float64Array} positions (N, 3) */
    constructor(positions) {
        this.#positions = positions;
        this.#order = Uint32Array.from({ length: positions.length / 3 }, (_, i) => i);
        this.#split(0, this.#order.length, 0);
    }

    /**
     * The points nearest to one of them, itself first.
     *
     * @param {number} point
     * @param {number} count
     * @returns {{points: number[], squares: number[]}} nearest first, and the squares of their distances
     */
    nearest(point, count) {
        const found = { points: [], squares: [], count };
        const at = this.#positions.subarray(3 * point, 3 * point + 3);
        this.#search(0, this.#order.length, 0, at, found);
        return found;
    }

    #split(first, end, axis) {
        if (end - first <= LEAF) {
            return;
        }
        const middle = (first + end) >> 1;
        this.#place(first, end - 1, middle, axis);
        this.#split(first, middle, (axis + 1) % 3);
        this.#split(middle + 1, end, (axis + 1) % 3);
    }

    /** Put at `middle` what sorting would put there, smaller ones before and larger ones behind (Hoare 1961). */
    #place(low, high, middle, axis) {
        const order = this.#order;
        const value = (i) => this.#positions[3 * order[i] + axis];
        while (low < high) {
            const pivot = value((low + high) >> 1);
            let [left, right] = [low, high];
            while (left <= right) {
                while (value(left) < pivot) {
                    left++;
                }
                while (value(right) > pivot) {
                    right--;
                }
                if (left <= right) {
                    const kept = order[left];
                    order[left++] = order[right];
                    order[right--] = kept;
                }
            }
            if (middle <= right) {
                high = right;
            } else if (middle >= left) {
                low = left;
            } else {
                return;
            }
        }
    }

    #search(first, end, axis, at, found) {
        if (end - first <= LEAF) {
            for (let i = first; i < end; i++) {
                this.#offer(this.#order[i], at, found);
            }
            return;
        }
        const middle = (first + end) >> 1;
        const point = this.#order[middle];
        const beyond = at[axis] - this.#positions[3 * point + axis];
        const next = (axis + 1) % 3;
        const halves = [[first, middle], [middle + 1, end]];
        const [near, far] = beyond < 0 ? halves : halves.reverse();
        this.#search(near[0], near[1], next, at, found);
        this.#offer(point, at, found);
        if (found.squares.length < found.count || beyond * beyond < found.squares.at(-1)) {
            this.#search(far[0], far[1], next, at, found);
        }
    }

    #offer(point, at, { points, squares, count }) {
        const [x, y, z] = [0, 1, 2].map((axis) => this.#positions[3 * point + axis] - at[axis]);
        const square = x * x + y * y + z * z;
        if (squares.length === count && square >= squares[count - 1]) {
            return;
        }
        let place = squares.length === count ? count - 1 : squares.length;
        for (; place > 0 && squares[place - 1] > square; place--) {
            squares[place] = squares[place - 1];
            points[place] = points[place - 1];
        }
        squares[place] = square;
        points[place] = point;
    }
}
