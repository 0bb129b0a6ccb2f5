/**
 * Writing PocketGS' own `.pgs`, rounded to grids alone; the twin of `formats/pgs.py`, which documents the layout.
 *
 * @module
 */

import { LOG_SCALE, MEAN, OPACITY_LOGIT, QUATERNION } from "../../page/constants.js";
import { coarsenessOf, codeColours, codeHarmonic, codeScales } from "../../page/formats/pgs_attributes.js";
import { codeTurns, nearestBefore } from "../../page/formats/pgs_attributes.js";
import { levelsOf, roundedMeans, roundedRotations } from "./pgs_rounding.js";
import { joinSections } from "./pgs_sections.js";
import { encodePositions, inTreeOrder } from "./pgs_tree.js";
import { RangeEncoder } from "./range_encoder.js";

/**
 * @typedef {import("../../page/scene/gaussian_columns.js").GaussianColumns} GaussianColumns
 * @typedef {import("../../page/formats/pgs_attributes.js").Code} Code
 */

const SCENE_BYTES = 44;
const THREE = [0, 1, 2];

/** Columns that take about as long as those of one coefficient: of positions, scales, rotations, opacity and colour. */
const SHAPE_STEPS = 5;

/**
 * @param {GaussianColumns} scene
 * @param {Object} settings the settings' `pgs`
 * @param {(share: number) => Promise<void>} onShare called with the share that is done
 * @returns {Promise<Blob>}
 * @throws {Error} a number is not finite
 */
export async function pgsOf(scene, settings, onShare = async () => {}) {
    if (![scene.shape, scene.sh].every((values) => values.every(Number.isFinite))) {
        throw new Error("the scene holds numbers that are not finite, which .pgs cannot hold");
    }
    const steps = SHAPE_STEPS + scene.coefficients - 1;
    let done = 0;
    const next = () => onShare(++done / steps);
    const rounded = inOrder(roundedShape(scene, settings));
    const { cells, bits, scales, turns, fineness, order } = rounded;
    const sections = [["scene", fieldsOf(scene, rounded, settings.coding)], ["position", encodePositions(cells, bits)]];
    await next();
    sections.push(["scale", written((code) => codeScales(code, scales, coarsenessOf(cells)))]);
    await next();
    sections.push(["rotation", written((code) => codeTurns(code, turns, fineness))]);
    await next();
    const { coding, max_level: most, max_logit: largest } = settings;
    const logits = scene.column(OPACITY_LOGIT).map((logit) => Math.max(-largest, Math.min(logit, largest)));
    const opacities = taken(levelsOf(logits, coding.opacity, most), order);
    sections.push(["opacity", written((code) => code(opacities, new Uint8Array(scene.count)))]);
    await next();
    const colours = THREE.map((channel) => taken(levelsOf(scene.harmonics(0, channel), coding.colour, most), order));
    sections.push(["colour", written((code) => codeColours(code, colours, nearestBefore(cells)))]);
    await next();
    if (scene.coefficients > 1) {
        const { code, coder } = writing();
        for (let place = 1; place < scene.coefficients; place++) {
            const of = (channel) => levelsOf(scene.harmonics(place, channel), coding.harmonics, most);
            codeHarmonic(code, THREE.map((channel) => taken(of(channel), order)));
            await next();
        }
        sections.push(["harmonic", coder.finish()]);
    }
    return new Blob([joinSections(sections)], { type: "application/octet-stream" });
}

/** Centres, sizes and rotations on the grids. */
function roundedShape(scene, { coding, grid_bits: gridBits, max_level: most, renamings }) {
    const columns = (first, count = 3) => Array.from({ length: count }, (_, i) => scene.column(first + i));
    const logScales = columns(LOG_SCALE);
    const levels = logScales.map((column) => levelsOf(column, coding.log_scale, most));
    return {
        ...roundedMeans(columns(MEAN), logScales, coding.position, gridBits),
        ...roundedRotations(levels, columns(QUATERNION, 4), coding, renamings),
    };
}

/** The same in the order of the file, with that order and the bits of a coordinate. */
function inOrder({ cells, scales, turns, fineness, ...others }) {
    const order = inTreeOrder(cells);
    const most = cells.reduce((all, column) => column.reduce((sum, value) => Math.max(sum, value), all), 0);
    const sorted = (columns) => columns.map((column) => taken(column, order));
    const [swing, twist] = sorted([fineness.swing, fineness.twist]);
    return {
        ...others,
        order,
        bits: 32 - Math.clz32(most),
        cells: sorted(cells),
        scales: sorted(scales),
        turns: sorted(turns),
        fineness: { swing, twist },
    };
}

const taken = (column, order) => column.map((_, i) => column[order[i]]);

function fieldsOf({ count, coefficients }, { bits, exponent, origin }, coding) {
    const view = new DataView(new ArrayBuffer(SCENE_BYTES));
    view.setUint32(0, count, true);
    view.setUint8(8, Math.sqrt(coefficients) - 1);
    view.setUint8(9, bits);
    view.setInt16(10, exponent, true);
    origin.forEach((value, axis) => view.setInt32(12 + 4 * axis, value, true));
    const steps = [coding.log_scale, coding.rotation, coding.opacity, coding.colour, coding.harmonics];
    steps.forEach((step, i) => view.setFloat32(24 + 4 * i, step, true));
    return new Uint8Array(view.buffer);
}

/** How columns are written, and the coder that they go to. */
function writing() {
    const coder = new RangeEncoder();
    const code = (values, contexts, neighbours) => {
        coder.column(values, contexts, undefined, neighbours);
        return Int32Array.from(values);
    };
    return { code, coder };
}

/** A section of columns. @type {(describe: (code: Code) => void) => Uint8Array} */
function written(describe) {
    const { code, coder } = writing();
    describe(code);
    return coder.finish();
}
