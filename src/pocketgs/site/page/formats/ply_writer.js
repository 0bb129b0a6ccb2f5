/**
 * Writing the `.ply` of the reference 3DGS implementation; see `formats/ply.py`.
 *
 * @module
 */

import { columnsOf } from "../../page/formats/ply_columns.js";

/**
 * @param {import("../../page/scene/gaussian_columns.js").GaussianColumns} scene
 * @returns {Blob}
 */
export function plyOf(scene) {
    const columns = columnsOf(scene);
    const names = namesFor(scene.coefficients);
    const table = new DataView(new ArrayBuffer(4 * names.length * scene.count));
    names.forEach((name, column) => {
        const values = columns.get(name);
        for (let row = 0; row < scene.count; row++) {
            table.setFloat32(4 * (row * names.length + column), values ? values[row] : 0, true);
        }
    });
    const properties = names.map((name) => `property float ${name}`);
    const begin = ["ply", "format binary_little_endian 1.0", `element vertex ${scene.count}`];
    const header = [...begin, ...properties, "end_header", ""].join("\n");
    return new Blob([header, table], { type: "application/octet-stream" });
}

/** All properties in their order. No column has the normals, which are zero. */
function namesFor(coefficients) {
    const several = (name, count) => Array.from({ length: count }, (_, i) => `${name}${i}`);
    const shape = ["opacity", ...several("scale_", 3), ...several("rot_", 4)];
    const colours = [...several("f_dc_", 3), ...several("f_rest_", 3 * (coefficients - 1))];
    return ["x", "y", "z", "nx", "ny", "nz", ...colours, ...shape];
}
