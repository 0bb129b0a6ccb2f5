/**
 * Lenses that distort; the twin of `distort` and `undistort` in `geometry/lens.py`. Formulas are OpenCV's.
 *
 * @module
 */

/**
 * @typedef {Object} Lens
 * @property {"opencv" | "fisheye"} model
 * @property {number[]} coefficients k1, k2, p1, p2, k3, k4, k5, k6, or of a fisheye k1, k2, k3, k4
 */

/** Names of the coefficients, in their order. */
const NAMES = { opencv: ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"], fisheye: ["k1", "k2", "k3", "k4"] };

/** Maximum number of steps in which a point is approached from the axis. */
const ROUNDS = 48;

/**
 * A lens from coefficients that a file names.
 *
 * @param {boolean} isFisheye
 * @param {(name: string) => number | null | undefined} valueOf where there is none, 0 is taken
 * @returns {Lens}
 */
export function lensOf(isFisheye, valueOf) {
    const model = isFisheye ? "fisheye" : "opencv";
    return { model, coefficients: NAMES[model].map((name) => valueOf(name) ?? 0) };
}

/** Whether the projection differs from a pinhole camera's. @type {(lens: Lens) => boolean} */
export function distorts({ model, coefficients }) {
    return model !== "opencv" || coefficients.some((value) => value !== 0);
}

/**
 * Where a lens shows a direction.
 *
 * @param {Lens} lens
 * @param {number} x normalised coordinates: x/z and y/z
 * @param {number} y
 * @returns {[number, number]} distorted ones
 */
export function distorted({ model, coefficients }, x, y) {
    const square = x * x + y * y;
    if (model === "fisheye") {
        const radius = Math.max(Math.sqrt(square), 1e-12);
        const angle = Math.atan(radius);
        const bend = coefficients.reduce((sum, value, i) => sum + value * angle ** (2 * i + 2), 1);
        return [(x * angle * bend) / radius, (y * angle * bend) / radius];
    }
    const [k1, k2, p1, p2, k3, k4, k5, k6] = coefficients;
    const radial =
        (1 + square * (k1 + square * (k2 + square * k3))) / (1 + square * (k4 + square * (k5 + square * k6)));
    return [
        x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
        y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
    ];
}

/**
 * The inverse of `distorted`. The point is approached from the axis in steps, each solved by Newton's method and halved
 * if that fails: it stays on the branch of the inverse that belongs to the lens, and ends where that ends.
 *
 * @param {Lens} lens
 * @param {number} x distorted normalised coordinates
 * @param {number} y
 * @param {{max_half_field: number, max_step: number}} bounds the settings' `capture`
 * @returns {[number, number]}
 */
export function undistorted(lens, x, y, bounds) {
    let [found, reached, stride] = [[0, 0], 0, 1 / 8];
    for (let round = 0; round < ROUNDS && reached < 1; round++) {
        const share = Math.min(reached + stride, 1);
        const guess = followed(lens, found, [share * x, share * y], bounds);
        if (guess) {
            [found, reached] = [guess, share];
        } else {
            stride /= 2;
        }
    }
    return found;
}

function followed(lens, start, target, bounds) {
    let guess = start;
    let slopes;
    for (let round = 0; round < 4; round++) {
        slopes = jacobian(lens, guess);
        const value = distorted(lens, ...guess);
        const [right, down] = [target[0] - value[0], target[1] - value[1]];
        const area = slopes[0] * slopes[3] - slopes[1] * slopes[2];
        guess = [
            guess[0] + (right * slopes[3] - down * slopes[1]) / area,
            guess[1] + (down * slopes[0] - right * slopes[2]) / area,
        ];
    }
    const value = distorted(lens, ...guess);
    const isSolved = Math.max(Math.abs(value[0] - target[0]), Math.abs(value[1] - target[1])) < 1e-8;
    const isUnfolded = slopes[0] > 0 && slopes[3] > 0 && slopes[0] * slopes[3] > slopes[1] * slopes[2];
    const [angle, before] = [guess, start].map((point) => Math.atan(Math.hypot(...point)));
    const isNear = Math.abs(angle - before) < bounds.max_step && angle < bounds.max_half_field;
    return isSolved && isUnfolded && isNear ? guess : null;
}

/** Derivatives by central differences: of the first coordinate by x and y, then of the second. */
function jacobian(lens, [x, y]) {
    const small = 1e-6;
    const [left, right] = [distorted(lens, x - small, y), distorted(lens, x + small, y)];
    const [above, below] = [distorted(lens, x, y - small), distorted(lens, x, y + small)];
    return [right[0] - left[0], below[0] - above[0], right[1] - left[1], below[1] - above[1]].map(
        (difference) => difference / (2 * small),
    );
}
