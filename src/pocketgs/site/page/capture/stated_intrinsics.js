/**
 * Intrinsics of a frame in a transforms JSON file, stated as numbers, as fields of view, or as a matrix; see
 * `capture/formats/stated_intrinsics.py`.
 *
 * @module
 */

import { storedSize } from "./image_header.js";

/** Only the NeRFCapture app writes this field, beside ARKit's numbers unchanged. */
export const NERFCAPTURE_FIELD = "depth_integer_scale";

const MATRIX_FIELDS = ["K", "intrinsics", "intrinsic_matrix", "camera_intrinsics"];
const [FOCALS, ANGLES] = [["fl_x", "fl_y"], ["camera_angle_x", "camera_angle_y"]];
const [SIZE, OTHER_SIZE] = [["w", "h"], ["width", "height"]];

/** Fields that a frame may state, the first of which counts, with the whole file's that then no longer hold for it. */
const REPLACED = [
    [
        [FOCALS, [...ANGLES, ...MATRIX_FIELDS]],
        [ANGLES, [...FOCALS, ...MATRIX_FIELDS]],
        [MATRIX_FIELDS, [...FOCALS, ...ANGLES, ...MATRIX_FIELDS, "cx", "cy"]],
    ],
    [[SIZE, OTHER_SIZE], [OTHER_SIZE, SIZE]],
    [[["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"], ["distortion_params"]]],
];

/** A frame's fields over those of the whole file, but for what the frame states itself in another way. */
export function overShared(own, shared) {
    const values = { ...shared.values };
    for (const same of REPLACED) {
        const found = same.find(([stated]) => stated.some((name) => (own.values[name] ?? null) !== null));
        found?.[1].forEach((name) => delete values[name]);
    }
    return own.over({ values });
}

/**
 * Read the intrinsics of a frame. A matrix is used only if no focal length or field of view is stated.
 *
 * @param {import("./json_fields.js").Fields} fields the frame's fields, over those of the whole file
 * @param {import("../archive/tree.js").StoredFile} file the image, whose size is used if none is stated
 * @param {{arkit_pixel_centre: number}} bounds the settings' `capture`
 * @returns {Promise<{size: number[], focal: number[], centre: number[]}>} in pixels
 * @throws {Error} no focal length is stated, or a field is malformed
 */
export async function readIntrinsics(fields, file, { arkit_pixel_centre: half }) {
    const [width, height] = statedSize(fields) ?? (await storedSize(file));
    let fx = focalLength(fields, "fl_x", "camera_angle_x", width);
    let fy = focalLength(fields, "fl_y", "camera_angle_y", height);
    const matrix = fx === null && fy === null ? readMatrix(fields) : null;
    if (matrix) {
        [fx, fy] = [matrix[0][0], matrix[1][1]];
    }
    if (fx === null && fy === null) {
        throw new Error(`${fields.where}: no focal length, expected fl_x, camera_angle_x or a 3x3 matrix K`);
    }
    const middle = matrix ? [matrix[0][2], matrix[1][2]] : [width / 2, height / 2];
    const offset = NERFCAPTURE_FIELD in fields.values ? half : 0;
    const centre = ["cx", "cy"].map((name, axis) => {
        const stated = fields.optionalNumber(name);
        return stated === null ? middle[axis] : stated + offset;
    });
    // Pixels are square unless the file states otherwise.
    return { size: [width, height], focal: [fx ?? fy, fy ?? fx], centre };
}

function statedSize(fields) {
    for (const names of [SIZE, OTHER_SIZE]) {
        const [width, height] = names.map((name) => fields.optionalNumber(name));
        if (width !== null && height !== null && (width || height)) {
            return [width, height];
        }
    }
    return null;
}

function focalLength(fields, focalName, angleName, side) {
    const [focal, angle] = [fields.optionalNumber(focalName), fields.optionalNumber(angleName)];
    if (focal !== null || angle === null) {
        return focal;
    }
    if (!(angle > 0 && angle < Math.PI)) {
        throw new Error(`${fields.where}: field '${angleName}' is ${angle}, expected radians between 0 and pi`);
    }
    return side / (2 * Math.tan(angle / 2));
}

/** Rows of three or four numbers, or nine numbers; by rows as usual, or by columns as Apple writes it. */
function readMatrix(fields) {
    const name = MATRIX_FIELDS.find((name) => (fields.values[name] ?? null) !== null);
    if (name === undefined) {
        return null;
    }
    const value = fields.values[name];
    const isFlat = Array.isArray(value) && value.length === 9;
    const rows = isFlat
        ? [0, 3, 6].map((first) => fields.numbers(name, 9).slice(first, first + 3))
        : fields.matrix(name, [3, 4], value?.[0]?.length === 4 ? 4 : 3).slice(0, 3);
    const isByColumns = rows[0][2] === 0 && rows[1][2] === 0;
    const matrix = isByColumns ? [0, 1, 2].map((column) => rows.map((row) => row[column])) : rows;
    const isLast = [0, 0, 1].every((value, i) => Math.abs(matrix[2][i] - value) <= 1e-5);
    if (!isLast || matrix[1][0] !== 0) {
        throw new Error(`${fields.where}: field '${name}' is not an intrinsic matrix (fx s cx; 0 fy cy; 0 0 1)`);
    }
    return matrix;
}
