// What eliminating the points takes from the equations of the shared unknowns: of their block focal, mixed and radial, and
// two entries of the right-hand side. One workgroup.
import reprojection, blocks.point

@group(0) @binding(1) var<storage, read> point_blocks: array<f32>;
@group(0) @binding(2) var<storage, read_write> shared_sums: array<f32>;

var<workgroup> of_matrix: array<vec3f, THREADS>;
var<workgroup> of_right: array<vec2f, THREADS>;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32) {
    var matrix = vec3f();
    var right = vec2f();
    for (var i = thread; i < adjustment.points; i += THREADS) {
        let inverse = inverse_of(i);
        let focal = inverse * vector_of(i, SHARED);
        let radial = inverse * vector_of(i, SHARED + 3u);
        matrix += vec3f(
            dot(focal, vector_of(i, SHARED)),
            dot(radial, vector_of(i, SHARED)),
            dot(radial, vector_of(i, SHARED + 3u)),
        );
        right += vec2f(dot(focal, vector_of(i, GRADIENT)), dot(radial, vector_of(i, GRADIENT)));
    }
    of_matrix[thread] = matrix;
    of_right[thread] = right;
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if (thread < half) {
            of_matrix[thread] += of_matrix[thread + half];
            of_right[thread] += of_right[thread + half];
        }
    }
    if (thread == 0u) {
        for (var k = 0u; k < 3u; k++) {
            shared_sums[k] = of_matrix[0][k];
        }
        shared_sums[3] = of_right[0].x;
        shared_sums[4] = of_right[0].y;
    }
}
