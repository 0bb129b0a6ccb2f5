// Every point's block H_pp, damped and inverted, its gradient, and what its observations add to the equations. One thread
// per point.
import reprojection.camera, blocks.point, blocks.sight, workgroups

@group(0) @binding(1) var<storage, read> cameras: array<f32>;
@group(0) @binding(2) var<storage, read> positions: array<f32>;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read> frames: array<u32>;
@group(0) @binding(5) var<storage, read> pixels: array<vec2f>;
@group(0) @binding(6) var<storage, read_write> point_blocks: array<f32>;
@group(0) @binding(7) var<storage, read_write> sights: array<f32>;
@group(0) @binding(8) var<storage, read_write> eliminated: array<f32>;

fn write_point(i: u32, word: u32, value: vec3f) {
    for (var axis = 0u; axis < 3u; axis++) {
        point_blocks[POINT_WORDS * i + word + axis] = value[axis];
    }
}

fn write_sight(observation: u32, found: Linearised) {
    let row = SIGHT_WORDS * observation;
    for (var axis = 0u; axis < 2u; axis++) {
        let first = row + select(OF_X, OF_Y, axis == 1u);
        for (var a = 0u; a < 3u; a++) {
            sights[first + a] = found.turn[axis][a];
            sights[first + 3u + a] = -found.point[axis][a];
        }
        sights[first + RESIDUAL] = found.residual[axis];
    }
    for (var a = 0u; a < CAMERA_UNKNOWNS; a++) {
        let coupling = sights[row + OF_X + a] * found.point[0] + sights[row + OF_Y + a] * found.point[1];
        for (var axis = 0u; axis < 3u; axis++) {
            sights[row + COUPLING + 3u * a + axis] = coupling[axis];
        }
    }
}

// The inverse by the Cholesky factor L, (L⁻¹)ᵀ L⁻¹: cofactors would lose all digits for a point that is seen with little
// parallax. Single precision may leave nothing of a pivot either; a share of its diagonal stands in for it, which is more
// damping for what the photographs do not tell.
fn write_inverse(i: u32, matrix: mat3x3f) {
    let a = inverseSqrt(matrix[0].x);
    let l10 = matrix[0].y * a;
    let l20 = matrix[0].z * a;
    let b = inverseSqrt(max(matrix[1].y - l10 * l10, LEAST_PIVOT * matrix[1].y));
    let l21 = (matrix[1].z - l20 * l10) * b;
    let c = inverseSqrt(max(matrix[2].z - l20 * l20 - l21 * l21, LEAST_PIVOT * matrix[2].z));
    let i10 = -l10 * a * b;
    let i21 = -l21 * b * c;
    let i20 = -(l20 * a + l21 * i10) * c;
    write_point(i, INVERSE, vec3f(a * a + i10 * i10 + i20 * i20, b * b + i21 * i21, c * c));
    write_point(i, INVERSE + 3u, vec3f(i10 * b + i20 * i21, i20 * c, i21 * c));
}

fn eliminate(observation: u32, inverse: mat3x3f) {
    for (var a = 0u; a < CAMERA_UNKNOWNS; a++) {
        let row = inverse * coupling_of(observation, a);
        for (var axis = 0u; axis < 3u; axis++) {
            eliminated[COUPLING_WORDS * observation + 3u * a + axis] = row[axis];
        }
    }
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = folded(workgroup) * THREADS + thread;
    if (i >= adjustment.points) {
        return;
    }
    let position = vec3f(positions[3u * i], positions[3u * i + 1u], positions[3u * i + 2u]);
    var matrix = mat3x3f();
    var gradient = vec3f();
    for (var k = starts[i]; k < starts[i + 1u]; k++) {
        let found = linearised(read_camera(frames[k]), position, pixels[k]);
        write_sight(k, found);
        for (var axis = 0u; axis < 2u; axis++) {
            let slope = found.point[axis];
            gradient -= slope * found.residual[axis];
            for (var column = 0u; column < 3u; column++) {
                matrix[column] += slope * slope[column];
            }
        }
    }
    var damping = vec3f();
    for (var axis = 0u; axis < 3u; axis++) {
        damping[axis] = adjustment.damping * max(matrix[axis][axis], MIN_DIAGONAL);
        matrix[axis][axis] = max(matrix[axis][axis] + damping[axis], LEAST_PIVOT * MIN_DIAGONAL);
    }
    write_inverse(i, matrix);
    write_point(i, GRADIENT, gradient);
    write_point(i, DAMPING, damping);
    let inverse = inverse_of(i);
    for (var k = starts[i]; k < starts[i + 1u]; k++) {
        eliminate(k, inverse);
    }
}
