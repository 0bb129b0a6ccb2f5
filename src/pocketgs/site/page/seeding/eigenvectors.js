/**
 * Eigenvectors of symmetric 3 x 3 matrices by Jacobi's rotations (Golub and Van Loan, section 8.5).
 *
 * @module
 */

const SWEEPS = 12;
const PLANES = [[0, 1], [0, 2], [1, 2]];

/**
 * @param {number[][]} matrix symmetric
 * @returns {number[][]} unit vectors, that of the smallest eigenvalue first
 */
export function eigenvectors(matrix) {
    const a = matrix.map((row) => [...row]);
    const vectors = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    for (let sweep = 0; sweep < SWEEPS; sweep++) {
        for (const [p, q] of PLANES) {
            if (a[p][q] !== 0) {
                rotate(a, vectors, p, q);
            }
        }
    }
    return [0, 1, 2].sort((i, j) => a[i][i] - a[j][j]).map((i) => vectors[i]);
}

/** Turn the plane of two axes so that the matrix has no entry between them. */
function rotate(a, vectors, p, q) {
    const slope = (a[q][q] - a[p][p]) / (2 * a[p][q]);
    const t = Math.sign(slope || 1) / (Math.abs(slope) + Math.hypot(slope, 1));
    const c = 1 / Math.hypot(t, 1);
    const s = t * c;
    for (const rows of [a, vectors]) {
        [rows[p], rows[q]] = [
            rows[p].map((value, i) => c * value - s * rows[q][i]),
            rows[q].map((value, i) => c * value + s * rows[p][i]),
        ];
    }
    for (const row of a) {
        [row[p], row[q]] = [c * row[p] - s * row[q], c * row[q] + s * row[p]];
    }
}
