/**
 * Neighbourhoods of points of which some coincide; the twin of `_neighbourhoods` in `seeding/seeds.py`.
 *
 * @module
 */

/**
 * The neighbourhood of every point among points elsewhere: coincident ones say nothing of the surface.
 *
 * @param {import("./neighbour_search.js").NeighbourSearch} search
 * @param {Float64Array} positions (N, 3), along a Morton curve
 * @param {number} fewest how many distinct ones there must be
 * @returns {Promise<import("./neighbour_search.js").Neighbourhoods>}
 * @throws {Error} there are fewer, or the GPU's memory does not hold them
 */
export async function distinctNeighbourhoods(search, positions, fewest) {
    const { distinct, rows } = distinctPositions(positions);
    if (distinct.length < 3 * fewest) {
        const found = `${rows.length} points to start from, ${distinct.length / 3} of them distinct`;
        throw new Error(`${found}: at least ${fewest} are needed.`);
    }
    const { spacing, normals, tangents } = await search.around(distinct);
    const [allNormals, allTangents] = [normals, tangents].map((axes) => {
        return Float32Array.from(positions, (_, i) => axes[3 * rows[Math.floor(i / 3)] + (i % 3)]);
    });
    return { spacing: Float64Array.from(rows, (row) => spacing[row]), normals: allNormals, tangents: allTangents };
}

/** Positions without repetitions, in the order in which they come first, and the row among them of every point. */
function distinctPositions(positions) {
    const [known, distinct] = [new Map(), []];
    const rows = Uint32Array.from({ length: positions.length / 3 }, (_, point) => {
        const position = positions.subarray(3 * point, 3 * point + 3);
        const key = position.join(" ");
        if (!known.has(key)) {
            known.set(key, known.size);
            distinct.push(...position);
        }
        return known.get(key);
    });
    return { distinct: Float64Array.from(distinct), rows };
}
