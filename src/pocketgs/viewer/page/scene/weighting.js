/**
 * What the weights of a scene that is drawn without sorting are made from; the twin of `sort_free/scene.py` and of the
 * names in `sort_free/forms.py`.
 *
 * @module
 */

/** The numbers that each form shares among all Gaussians, in their order, and whether it has coefficients. */
const FORMS = {
    direct: { numbers: ["background"], hasViews: false },
    exponential: { numbers: ["sigma", "beta", "background"], hasViews: false },
    lc: { numbers: ["sigma", "background"], hasViews: true },
    mobile: { numbers: [], hasViews: true },
    visibility: { numbers: ["sigma"], hasViews: true },
};

const COEFFICIENTS = [1, 4, 9, 16];

/** Units, and logarithms of numbers, past these come from broken files only. */
const MAX_UNIT = 1e15;
const MAX_LOGARITHM = 20;

/**
 * The names of a form's numbers.
 *
 * @param {string} form
 * @returns {string[]}
 * @throws {Error} there is no such form
 */
export function numbersOf(form) {
    if (!Object.hasOwn(FORMS, form)) {
        throw new Error(`sort-free form '${form}': not known, expected one of ${Object.keys(FORMS).join(", ")}`);
    }
    return FORMS[form].numbers;
}

/** A form, its numbers, and the coefficients of N Gaussians. */
export class Weighting {
    /**
     * @param {string} form its name
     * @param {number} unit length that distances are measured in, in scene units
     * @param {number[]} numbers positive, in the form's order
     * @param {number} coefficients per Gaussian
     * @param {number} count of Gaussians
     * @throws {Error} a value is out of range, or they do not belong together
     */
    constructor(form, unit, numbers, coefficients, count) {
        const names = numbersOf(form);
        const isSound = (value) => Math.abs(Math.log(value)) < MAX_LOGARITHM;
        if (numbers.length !== names.length || !numbers.every(isSound)) {
            throw new Error(
                `sort-free form '${form}': numbers ${numbers}, expected ${names.length} that float32 can hold`,
            );
        }
        if (!(unit > 1 / MAX_UNIT && unit < MAX_UNIT)) {
            throw new Error(`sort-free form '${form}': unit ${unit}, expected one that float32 can hold`);
        }
        if (FORMS[form].hasViews ? !COEFFICIENTS.includes(coefficients) : coefficients !== 0) {
            throw new Error(`sort-free form '${form}': ${coefficients} coefficients of each weight, expected ${
                FORMS[form].hasViews ? COEFFICIENTS.join(" or ") : 0
            }`);
        }
        this.form = form;
        this.unit = unit;
        /** @type {Object<string, number>} */
        this.numbers = Object.fromEntries(names.map((name, i) => [name, numbers[i]]));
        this.coefficients = coefficients;
        this.count = count;
        /** (K, N): coefficient by coefficient. */
        this.views = new Float32Array(coefficients * count);
    }

    /**
     * @param {number} coefficient
     * @returns {Float32Array} a view of its N numbers
     */
    column(coefficient) {
        return this.views.subarray(coefficient * this.count, (coefficient + 1) * this.count);
    }

    /** Fields of the struct `Weighting` in `shaders/common/weights.wgsl`. @returns {Object<string, number>} */
    get uniform() {
        const absent = { sigma: 0, beta: 0, background: 0 };
        return { unit: this.unit, ...absent, ...this.numbers, view_coefficients: this.coefficients };
    }
}
