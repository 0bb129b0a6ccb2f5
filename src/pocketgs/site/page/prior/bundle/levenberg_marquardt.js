/**
 * Levenberg-Marquardt minimisation with Nielsen's damping rule; the twin of `prior/bundle/levenberg_marquardt.py`
 * (Madsen, Nielsen and Tingleff, "Methods for non-linear least squares problems", 2004, algorithm 3.16).
 *
 * @module
 */

/**
 * Find a local minimum near a state.
 *
 * @template State
 * @param {State} start
 * @param {(state: State) => number} cost
 * @param {(state: State, damping: number) => {next: State, expected: number} | null} step the damped linear step and
 *     the decrease of the cost that the linear model predicts; null if there is none
 * @param {import("./adjustment.js").BundleSettings} settings
 * @returns {State} of lowest cost
 */
export function minimise(start, cost, step, settings) {
    const { iterations, tolerance, negligible, first_damping: first, min_damping: least } = settings;
    let [state, lowest] = [start, cost(start)];
    let [damping, growth] = [first, 2];
    for (let iteration = 0; iteration < iterations; iteration++) {
        const enough = tolerance * lowest + negligible;
        const tried = step(state, damping);
        if (tried && tried.expected <= enough) {
            break;
        }
        const reached = tried ? cost(tried.next) : Infinity;
        const decrease = lowest - reached;
        if (decrease > 0) {
            [state, lowest] = [tried.next, reached];
            if (decrease <= enough) {
                break;
            }
            const gain = decrease / tried.expected;
            damping = Math.max(damping * Math.max(1 / 3, 1 - (2 * gain - 1) ** 3), least);
            growth = 2;
        } else {
            [damping, growth] = [damping * growth, growth * 2];
        }
    }
    return state;
}
