/**
 * The kernel of a matrix with one column more than rows.
 *
 * @module
 */

/** Pivots below this share of the largest entry count as 0. */
const NEGLIGIBLE = 1e-12;

/**
 * Solve A x = 0 by elimination with complete pivoting.
 *
 * @param {Float64Array} matrix (n, n + 1) row by row, changed
 * @param {number} n
 * @returns {Float64Array | null} (n + 1,) x, of any length; null if the rows are linearly dependent
 */
export function kernelOf(matrix, n) {
    const columns = n + 1;
    const order = Array.from({ length: columns }, (_, column) => column);
    const at = (row, column) => row * columns + order[column];
    let largest = 0;
    for (let step = 0; step < n; step++) {
        let [pivot, pivotRow, pivotColumn] = [0, step, step];
        for (let row = step; row < n; row++) {
            for (let column = step; column < columns; column++) {
                const size = Math.abs(matrix[at(row, column)]);
                if (size > pivot) {
                    [pivot, pivotRow, pivotColumn] = [size, row, column];
                }
            }
        }
        largest = Math.max(largest, pivot);
        if (pivot <= NEGLIGIBLE * largest) {
            return null;
        }
        [order[step], order[pivotColumn]] = [order[pivotColumn], order[step]];
        for (let column = 0; column < columns; column++) {
            const [one, other] = [step * columns + column, pivotRow * columns + column];
            [matrix[one], matrix[other]] = [matrix[other], matrix[one]];
        }
        for (let row = step + 1; row < n; row++) {
            const factor = matrix[at(row, step)] / matrix[at(step, step)];
            for (let column = step; column < columns; column++) {
                matrix[at(row, column)] -= factor * matrix[at(step, column)];
            }
        }
    }
    const found = new Float64Array(columns);
    found[order[n]] = 1;
    for (let row = n - 1; row >= 0; row--) {
        let sum = 0;
        for (let column = row + 1; column < columns; column++) {
            sum += matrix[at(row, column)] * found[order[column]];
        }
        found[order[row]] = -sum / matrix[at(row, row)];
    }
    return found;
}
