/**
 * Systems of linear equations with a positive definite matrix.
 *
 * @module
 */

/**
 * The lower factor L of L Lᵀ (Cholesky), in place of the lower triangle.
 *
 * @param {Float64Array} matrix (n, n) row by row; only the lower triangle counts
 * @param {number} n
 * @returns {boolean} false if the matrix is not positive definite
 */
export function factorise(matrix, n) {
    for (let row = 0; row < n; row++) {
        const own = row * n;
        for (let column = 0; column <= row; column++) {
            const other = column * n;
            let sum = matrix[own + column];
            for (let k = 0; k < column; k++) {
                sum -= matrix[own + k] * matrix[other + k];
            }
            if (column < row) {
                matrix[own + column] = sum / matrix[other + column];
            } else if (sum > 0) {
                matrix[own + row] = Math.sqrt(sum);
            } else {
                return false;
            }
        }
    }
    return true;
}

/**
 * Solve L Lᵀ x = b.
 *
 * @param {Float64Array} factor from `factorise`
 * @param {Float64Array} right (n,) b, replaced by x
 */
export function substitute(factor, right) {
    const n = right.length;
    for (let row = 0; row < n; row++) {
        for (let k = 0; k < row; k++) {
            right[row] -= factor[row * n + k] * right[k];
        }
        right[row] /= factor[row * n + row];
    }
    for (let row = n - 1; row >= 0; row--) {
        right[row] /= factor[row * n + row];
        for (let k = 0; k < row; k++) {
            right[k] -= factor[row * n + k] * right[row];
        }
    }
}
