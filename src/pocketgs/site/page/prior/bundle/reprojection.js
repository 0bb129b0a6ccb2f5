/**
 * Reprojection errors and their derivatives by poses and points; the twin of `prior/bundle/reprojection.py`.
 *
 * @module
 */

/** Per camera: a rotation vector, then the centre. An update changes R to exp(ω) R and c to c + δ. */
export const CAMERA_UNKNOWNS = 6;

/** Columns of a Jacobian: the camera's unknowns, then the point's three coordinates. */
export const COLUMNS = CAMERA_UNKNOWNS + 3;

/**
 * @typedef {Object} Sightings observations sorted by point
 * @property {number[][]} intrinsics fx, fy, cx, cy of each camera
 * @property {Int32Array} frame
 * @property {Int32Array} point
 * @property {Int32Array} starts observations of point p are starts[p] to starts[p + 1]
 * @property {Float64Array} pixels (M, 2)
 *
 * @typedef {Object} Estimate the unknowns of bundle adjustment
 * @property {number[][]} rotations from world to camera axes, 3 x 3 row by row
 * @property {number[][]} centres in the world
 * @property {Float64Array} points (N, 3)
 *
 * @typedef {import("./adjustment.js").BundleSettings} BundleSettings
 */

/**
 * Reprojection errors in pixels, `behind` for points that are not in front of the camera.
 *
 * @param {Sightings} sightings
 * @param {Estimate} estimate
 * @param {BundleSettings} settings
 * @returns {Float64Array} (M,)
 */
export function distances(sightings, estimate, { grazing, behind }) {
    const [residual, jacobian] = [new Float64Array(2), new Float64Array(2 * COLUMNS)];
    return Float64Array.from(sightings.frame, (_, k) => {
        const isBefore = linearise(sightings, estimate, k, grazing, residual, jacobian);
        return isBefore ? Math.hypot(residual[0], residual[1]) : behind;
    });
}

/**
 * Write the residual of an observation, predicted minus observed, and its derivatives.
 *
 * @param {Sightings} sightings
 * @param {Estimate} estimate where to linearise
 * @param {number} k index of the observation
 * @param {number} grazing minimum cosine of the angle to the optical axis for a point in front of the camera
 * @param {Float64Array} residual (2,) in pixels
 * @param {Float64Array} jacobian (2, COLUMNS)
 * @returns {boolean} false for a point that is not in front of the camera: it has no residual and no gradient
 */
export function linearise(sightings, { rotations, centres, points }, k, grazing, residual, jacobian) {
    const { intrinsics, frame, point, pixels } = sightings;
    const [r, c, p] = [rotations[frame[k]], centres[frame[k]], 3 * point[k]];
    const [dx, dy, dz] = [points[p] - c[0], points[p + 1] - c[1], points[p + 2] - c[2]];
    const x = r[0] * dx + r[1] * dy + r[2] * dz;
    const y = r[3] * dx + r[4] * dy + r[5] * dz;
    const z = r[6] * dx + r[7] * dy + r[8] * dz;
    if (!(z > grazing * Math.sqrt(x * x + y * y + z * z))) {
        return false;
    }
    for (let axis = 0; axis < 2; axis++) {
        const focal = intrinsics[frame[k]][axis];
        const own = axis === 0 ? x / z : y / z;
        residual[axis] = focal * own + intrinsics[frame[k]][2 + axis] - pixels[2 * k + axis];
        // The gradient by (x, y, z), the point in camera axes. A rotation ω moves it by ω × (x, y, z), and
        // g · (ω × x) = ω · (x × g).
        const [across, down, inward] = [axis === 0 ? focal / z : 0, axis === 0 ? 0 : focal / z, (-focal * own) / z];
        const row = axis * COLUMNS;
        jacobian[row] = y * inward - z * down;
        jacobian[row + 1] = z * across - x * inward;
        jacobian[row + 2] = x * down - y * across;
        for (let column = 0; column < 3; column++) {
            const slope = across * r[column] + down * r[3 + column] + inward * r[6 + column];
            jacobian[row + 3 + column] = -slope;
            jacobian[row + CAMERA_UNKNOWNS + column] = slope;
        }
    }
    return true;
}

/**
 * Multiply both by √w, so that least squares has the gradient of the Huber loss: w = min(1, huber / |r|). Iteratively
 * reweighted least squares: Zhang, "Parameter estimation techniques" (1997), section 9.
 */
export function weigh(residual, jacobian, huber) {
    const length = Math.hypot(residual[0], residual[1]);
    if (length > huber) {
        const root = Math.sqrt(huber / length);
        residual.forEach((value, i) => (residual[i] = root * value));
        jacobian.forEach((value, i) => (jacobian[i] = root * value));
    }
}
