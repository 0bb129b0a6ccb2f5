// The equations' parts of a point, a row of `point_blocks`, and of an observation, a row of `sights` and one of
// `eliminated`. The passes bind those that they read.

section point
// First word of each part in a point's row: H_pp⁻¹, damped, as its diagonal and what is beside it; b_p; and what was added
// to the diagonal of H_pp.
const INVERSE: u32 = 0u;
const GRADIENT: u32 = 6u;
const DAMPING: u32 = 9u;

fn vector_of(point: u32, word: u32) -> vec3f {
    let first = POINT_WORDS * point + word;
    return vec3f(point_blocks[first], point_blocks[first + 1u], point_blocks[first + 2u]);
}

fn inverse_of(point: u32) -> mat3x3f {
    let diagonal = vector_of(point, INVERSE);
    let beside = vector_of(point, INVERSE + 3u);
    return mat3x3f(
        vec3f(diagonal.x, beside.x, beside.y),
        vec3f(beside.x, diagonal.y, beside.z),
        vec3f(beside.y, beside.z, diagonal.z),
    );
}

section sight
// First word of each part in an observation's row of `sights`: derivatives of the residual's x by the camera's unknowns,
// with the residual's x itself; the same of y; and H_cp, a row of three for each of the camera's unknowns.
const OF_X: u32 = 0u;
const OF_Y: u32 = COLUMNS;
const COUPLING: u32 = 2u * COLUMNS;

// Row a of an observation's H_cp.
fn coupling_of(observation: u32, a: u32) -> vec3f {
    let first = SIGHT_WORDS * observation + COUPLING + 3u * a;
    return vec3f(sights[first], sights[first + 1u], sights[first + 2u]);
}

section eliminated
// Row a of an observation's H_cp H_pp⁻¹.
fn eliminated_of(observation: u32, a: u32) -> vec3f {
    let first = COUPLING_WORDS * observation + 3u * a;
    return vec3f(eliminated[first], eliminated[first + 1u], eliminated[first + 2u]);
}
