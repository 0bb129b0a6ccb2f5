/**
 * Writing the `.ply` of the reference 3DGS implementation; see `formats/ply.py`.
 *
 * @module
 */

import { LOG_SCALE, MEAN, OPACITY_LOGIT, QUATERNION } from "../../page/scene/gaussian_columns.js";

/**
 * @param {import("../../page/scene/gaussian_columns.js").GaussianColumns} scene
 * @returns {Blob}
 */
export function plyOf(scene) {
    const columns = columnsOf(scene);
    const table = new DataView(new ArrayBuffer(4 * columns.length * scene.count));
    columns.forEach(([, values], column) => {
        for (let row = 0; row < scene.count; row++) {
            table.setFloat32(4 * (row * columns.length + column), values ? values[row] : 0, true);
        }
    });
    const properties = columns.map(([name]) => `property float ${name}`);
    const begin = ["ply", "format binary_little_endian 1.0", `element vertex ${scene.count}`];
    const header = [...begin, ...properties, "end_header", ""].join("\n");
    return new Blob([header, table], { type: "application/octet-stream" });
}

/** Names and numbers of all columns, in their order; normals are zero. */
function columnsOf(scene) {
    const several = (name, count, values) => Array.from({ length: count }, (_, i) => [`${name}${i}`, values(i)]);
    const higher = scene.coefficients - 1;
    return [
        ...["x", "y", "z"].map((name, axis) => [name, scene.column(MEAN + axis)]),
        ...["nx", "ny", "nz"].map((name) => [name, null]),
        ...several("f_dc_", 3, (channel) => scene.harmonics(0, channel)),
        ...several("f_rest_", 3 * higher, (i) => scene.harmonics(1 + (i % higher), Math.floor(i / higher))),
        ["opacity", scene.column(OPACITY_LOGIT)],
        ...several("scale_", 3, (axis) => scene.column(LOG_SCALE + axis)),
        ...several("rot_", 4, (part) => scene.column(QUATERNION + part)),
    ];
}
