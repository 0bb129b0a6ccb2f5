/**
 * Levenberg-Marquardt minimisation with Nielsen's damping rule; the twin of `prior/bundle/levenberg_marquardt.py`
 * (Madsen, Nielsen and Tingleff, "Methods for non-linear least squares problems", 2004, algorithm 3.16).
 *
 * @module
 */

const [FIRST_DAMPING, MIN_DAMPING] = [1e-4, 1e-12];

/** Smaller decreases of the cost are rounding errors, for residuals in pixels. */
const NEGLIGIBLE = 1e-15;

/**
 * Find a local minimum near a state.
 *
 * @template State
 * @param {State} start
 * @param {(state: State) => number} cost
 * @param {(state: State, damping: number) => {next: State, expected: number} | null} step the damped linear step and
 *     the decrease of the cost that the linear model predicts; null if there is none
 * @param {number} iterations maximum number of steps
 * @param {number} tolerance stop when a decrease is below this times the cost
 * @returns {State} of lowest cost
 */
export function minimise(start, cost, step, iterations, tolerance) {
    let [state, least] = [start, cost(start)];
    let [damping, growth] = [FIRST_DAMPING, 2];
    for (let iteration = 0; iteration < iterations; iteration++) {
        const enough = tolerance * least + NEGLIGIBLE;
        const tried = step(state, damping);
        if (tried && tried.expected <= enough) {
            break;
        }
        const reached = tried ? cost(tried.next) : Infinity;
        const decrease = least - reached;
        if (decrease > 0) {
            [state, least] = [tried.next, reached];
            if (decrease <= enough) {
                break;
            }
            const gain = decrease / tried.expected;
            damping = Math.max(damping * Math.max(1 / 3, 1 - (2 * gain - 1) ** 3), MIN_DAMPING);
            growth = 2;
        } else {
            [damping, growth] = [damping * growth, growth * 2];
        }
    }
    return state;
}
